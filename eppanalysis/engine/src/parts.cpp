// Parts of the engine that only its tests call from Python.

#include "engine/flow.hpp"
#include "engine/series.hpp"
#include "orbits/flow.hpp"
#include "periodic.hpp"
#include "python.hpp"
#include "verdict.hpp"

namespace epp {
inline namespace EPP_ARCH {

using F1 = View<double, 1>;
using F2 = View<double, 2>;

void parts(nb::module_& m) {
    nb::module_ part = m.def_submodule("parts", "Parts of the engine, for its tests.");
    part.def("first_rise", [](nb::handle series, double tolerance) {
        Call call;
        return first_rise(call.take<F1>(series, "series"), tolerance);
    });
    part.def("flow", [](nb::handle M, double h, double rate, nb::handle integral, nb::handle power, nb::handle half,
                        nb::handle term, nb::handle work) {
        Call call;
        const auto take = [&](nb::handle a) { return call.take<F2>(a, "flow"); };
        flow(take(M), h, rate, take(integral), take(power), take(half), take(term), take(work));
    });
    part.def("growth_rate", [](nb::handle M, nb::handle P, nb::handle Q) {
        Call call;
        return growth_rate(call.take<F2>(M, "M"), call.take<F2>(P, "P"), call.take<F2>(Q, "Q"));
    });
    part.def("compile_long", [](nb::handle combinations, nb::handle work, i64 q) {
        Call call;
        compile_long(call.take<Combinations>(combinations, "combinations"), call.take<Work>(work, "work"), q);
    });
    part.def("moving_states", [](nb::handle F) {
        Call call;
        return orbits_flow::room(call.take<View<double, 3>>(F, "F")).shape(1);
    });
    part.def("next_rise", [](nb::handle c, nb::handle phase, nb::handle value, i64 count, double phi, double here,
                             double level, double sign) {
        Call call;
        return periodic::next_rise(call.take<View<Complex, 1>>(c, "c"), call.take<F1>(phase, "phase"),
                                   call.take<F1>(value, "value"), count, phi, here, level, sign);
    });
    part.def("verdict", [](nb::handle t, nb::handle guard, nb::handle x, nb::handle v, double t_end, nb::handle low,
                           nb::handle high, nb::handle compared, nb::handle found) {
        Call call;
        const F1 times = call.take<F1>(t, "t");
        const F2 rates = call.take<F2>(v, "v");
        return verdict::verdict(times, call.take<View<i64, 1>>(guard, "guard"), call.take<F2>(x, "x"), rates,
                                times.size(), t_end, call.take<F1>(low, "low"), call.take<F1>(high, "high"),
                                rates.row(rates.shape(0) - 1), call.take<View<bool, 1>>(compared, "compared"), false,
                                call.take<F1>(found, "found"));
    });
    part.def("row_sum", [](nb::handle rows, nb::handle weights, double scale, nb::handle out) {
        Call call;
        row_sum(call.take<F2>(rows, "rows"), call.take<F1>(weights, "weights"), scale, call.take<F1>(out, "out"));
    });
    part.def("row_sum_from", [](nb::handle start, nb::handle rows, nb::handle weights, double scale, nb::handle out) {
        Call call;
        row_sum_from(call.take<F1>(start, "start"), call.take<F2>(rows, "rows"), call.take<F1>(weights, "weights"), scale,
                     call.take<F1>(out, "out"));
    });
    part.def("size_sum", [](nb::handle rows, i64 last, nb::handle out) {
        Call call;
        size_sum(call.take<F2>(rows, "rows"), last, call.take<F1>(out, "out"));
    });
    part.def("value_and_slope", [](nb::handle terms, double u) {
        Call call;
        const auto [value, slope] = value_and_slope(call.take<F1>(terms, "terms"), u);
        return nb::make_tuple(value, slope);
    });
    part.def("any_above", [](nb::handle row, double scale, nb::handle limits) {
        Call call;
        return any_above(call.take<F1>(row, "row"), scale, call.take<F1>(limits, "limits"));
    });
    part.def("keep_sparse", [](nb::handle M, nb::handle entries, nb::handle rows, nb::handle ends) {
        Call call;
        using I1 = View<i64, 1>;
        _keep_sparse(call.take<F2>(M, "M"), call.take<F2>(entries, "entries"), call.take<I1>(rows, "rows"),
                     call.take<I1>(ends, "ends"));
    });
    part.def("sparse_sum", [](nb::handle entries, nb::handle rows, nb::handle ends, nb::handle weights, double scale,
                              nb::handle out, bool sizes) {
        Call call;
        using I1 = View<i64, 1>;
        (sizes ? sparse_size_sum : sparse_sum)(call.take<F2>(entries, "entries"), call.take<I1>(rows, "rows"),
                                               call.take<I1>(ends, "ends"), call.take<F1>(weights, "weights"), scale,
                                               call.take<F1>(out, "out"));
    });
    part.def("sparse_sum_from", [](nb::handle start, nb::handle entries, nb::handle rows, nb::handle ends,
                                   nb::handle weights, double scale, nb::handle out) {
        Call call;
        using I1 = View<i64, 1>;
        sparse_sum_from(call.take<F1>(start, "start"), call.take<F2>(entries, "entries"), call.take<I1>(rows, "rows"),
                        call.take<I1>(ends, "ends"), call.take<F1>(weights, "weights"), scale, call.take<F1>(out, "out"));
    });
    part.def("dot", [](nb::handle a, nb::handle b) {
        Call call;
        return dot(call.take<F1>(a, "a"), call.take<F1>(b, "b"));
    });
    part.def("rises", [](nb::handle a, nb::handle b) {
        Call call;
        return rises(call.take<F1>(a, "a"), call.take<F1>(b, "b"));
    });
    part.def("polynomial", [](nb::handle rows, i64 last, double u, nb::handle out) {
        Call call;
        polynomial(call.take<F2>(rows, "rows"), last, u, call.take<F1>(out, "out"));
    });
    part.def("cubics_below", [](nb::handle a, nb::handle da, nb::handle step, nb::handle db, double third,
                                nb::handle noise, nb::handle stray) {
        Call call;
        const auto take = [&](nb::handle one) { return call.take<F1>(one, "row"); };
        return cubics_below(take(a), take(da), take(step), take(db), third, take(noise), take(stray));
    });
}

}  // namespace EPP_ARCH
}  // namespace epp
