#include "newton.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace newton {

/// What `shape_of` tells of each map.
Matrix shapes(Indices first, const std::tuple<Vector, Vector, Vector, Vector>& maps) {
    i64 i{}, j{};
    bool sloped{};
    double even{};
    Matrix shapes = empty<double>(first.size() - 1, 2);
    for (i64 e = 0, e_end = first.size() - 1; e < e_end; ++e) {
        i = first(e);
        j = first(e + 1);
        std::tie(sloped, even) = describing_piecewise::shape_of(std::get<0>(maps).slice(i, j),
            std::get<1>(maps).slice(i + e, j + e + 1), std::get<3>(maps).slice(i, j));
        shapes(e, 0) = sloped ? 1.0 : 0.0;
        shapes(e, 1) = even;
    }
    return shapes;
}

/// Inputs of some elements at some points, and what they make of them; not `free`, pivot and omega are held.
///
/// Arguments are those of `newton`, workspace for numbers of all points, and what is filled, from the point
/// `begin` on.
void describe(Matrix X, Indices points, i64 begin, Indices block, Indices places, i64 pivot, double relative,
    const std::tuple<Indices, std::tuple<Vector, Vector, Vector, Vector>, Matrix>& elements, Matrix shapes, bool free,
    Matrix row, ComplexMatrix inputs, const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements) {
    Vector x{};
    Matrix mean{};
    ComplexMatrix gain{};
    Matrices by_mean{};
    ComplexMatrices by_gain{};
    i64 k{}, i_{}, j{};
    double phase{}, gap{}, stiffness{}, damping{}, unilateral{}, lag{}, rate{}, bandwidth{}, a{}, b{}, omega{},
        beside{}, step{}, level_there{}, per{};
    std::tuple<Vector, Vector, Vector, Vector> table{};
    std::tuple<bool, double> shape{};
    bool rises{}, falls{};
    std::tuple<double, double, double> there{};
    Complex pull{}, change{}, law{}, by_error{};
    const std::tuple<Indices, std::tuple<Vector, Vector, Vector, Vector>, Matrix> was1 = elements;
    Indices first = std::get<0>(was1);
    Vector breakpoints = std::get<0>(std::get<1>(was1));
    Vector slopes = std::get<1>(std::get<1>(was1));
    Vector intercepts = std::get<2>(std::get<1>(was1));
    Vector jumps = std::get<3>(std::get<1>(was1));
    Matrix pins = std::get<2>(was1);
    std::tie(mean, gain, by_mean, by_gain) = of_elements;
    i64 n = points.size();
    i64 m = places.size();
    Vector size = row.row(0).slice(0, n);
    Vector bias = row.row(1).slice(0, n);
    Vector level = row.row(2).slice(0, n);
    Vector share = row.row(3).slice(0, n);
    Strided<double, 2> by = row.cut(Span{4, row.shape(0)}, Span{0, n});
    for (const auto& e : block) {
        for (i64 i = 0; i < n; ++i) {
            x = X.row(points(i));
            k = points(i) - begin;
            size(i) = std::exp(x(places(e)));
            bias(i) = x(2 * m + e);
            phase = (e != pivot) ? x(places(e) + 1) : 0.0;
            inputs(k, e) = Complex(size(i) * std::cos(phase), size(i) * std::sin(phase));
            for (i64 by_what = 0; by_what < 3; ++by_what) {
                {
                    const double was2 = 0.0;
                    const Complex was3 = Complex(0.0, 0.0);
                    by_mean(by_what, k, e) = was2;
                    by_gain(by_what, k, e) = was3;
                }
            }
        }
        gap = pins(e, 0);
        stiffness = pins(e, 1);
        damping = pins(e, 2);
        unilateral = pins(e, 3);
        if (stiffness == 0.0) {
            i_ = first(e);
            j = first(e + 1);
            table = std::tuple<Vector, Vector, Vector, Vector>{breakpoints.slice(i_, j), slopes.slice(i_ + e, j + e +
                1), intercepts.slice(i_ + e, j + e + 1), jumps.slice(i_, j)};
            shape = std::tuple<bool, double>{shapes(e, 0) != 0.0, shapes(e, 1)};
            describing_piecewise::describe(std::get<0>(table), std::get<1>(table), std::get<2>(table),
                std::get<3>(table), shape, size, bias, level, share, by);
            for (i64 i = 0; i < n; ++i) {
                k = points(i) - begin;
                {
                    const double was4 = level(i);
                    const Complex was5 = Complex(share(i), 0.0);
                    mean(k, e) = was4;
                    gain(k, e) = was5;
                }
                {
                    const double was6 = by(1, i) * size(i);
                    const Complex was7 = Complex(2.0 * (by(0, i) - share(i)), 0.0);
                    by_mean(0, k, e) = was6;
                    by_gain(0, k, e) = was7;
                }
                {
                    const double was8 = by(0, i);
                    const Complex was9 = Complex(by(1, i) * (2.0 / size(i)), 0.0);
                    by_mean(1, k, e) = was8;
                    by_gain(1, k, e) = was9;
                }
                rate = pins(e, 5);
                if (rate > 0.0) {
                    bandwidth = pins(e, 6);
                    omega = std::exp(X(points(i), 1));
                    std::tie(law, by_error) = describing_rate_limit::inside_at(size(i) * omega / rate,
                        bandwidth / omega);
                    gain(k, e) = omega * law;
                    by_gain(0, k, e) = omega * by_error;
                    by_gain(1, k, e) = Complex(0.0, 0.0);
                    if (free) {
                        omega *= 1.0 + relative;
                        std::tie(law, std::ignore) = describing_rate_limit::inside_at(size(i) * omega / rate,
                            bandwidth / omega);
                        by_gain(2, k, e) = (omega * law - gain(k, e)) / relative;
                    }
                    continue;
                }
                if (pins(e, 4) == 0.0) {
                    continue;
                }
                rises = (bias(i) + size(i)) > std::get<0>(table)(1);
                falls = (bias(i) - size(i)) < std::get<0>(table)(0);
                if (rises && falls) {
                    lag = pins(e, 4) / size(i) / size(i);
                    gain(k, e) -= Complex(0.0, lag);
                    by_gain(0, k, e) += Complex(0.0, 2.0 * lag);
                } else {
                    // It stays on a level: which one is not known where it reaches neither threshold.
                    {
                        const double was10 = intercepts(i_ + e + (rises ? 2 : (falls ? 0 : 1)));
                        const Complex was11 = Complex(0.0, 0.0);
                        mean(k, e) = was10;
                        gain(k, e) = was11;
                    }
                    for (i64 by_what = 0; by_what < 2; ++by_what) {
                        {
                            const double was12 = 0.0;
                            const Complex was13 = Complex(0.0, 0.0);
                            by_mean(by_what, k, e) = was12;
                            by_gain(by_what, k, e) = was13;
                        }
                    }
                }
            }
            continue;
        }
        for (i64 i = 0; i < n; ++i) {
            k = points(i) - begin;
            a = greatest_of(size(i), 1e-150);
            b = bias(i);
            omega = std::exp(X(points(i), 1));
            beside = b + (relative * a + 1e-12 * std::fabs(b));
            std::tie(mean(k, e), gain(k, e)) = describing_closed_forms::lock_pin_at(gap, stiffness, damping,
                unilateral != 0.0, a, b, omega);
            for (i64 by_what = (free || e != pivot) ? 0 : 1, by_what_end = free ? 3 : 2; by_what < by_what_end;
                ++by_what) {
                there = std::tuple<double, double, double>{(by_what == 0) ? a * (1.0 + relative) : a, (by_what == 1) ?
                    beside : b, (by_what == 2) ? omega * (1.0 + relative) : omega};
                step = (by_what == 1) ? greatest_of(beside - b, 1e-290) : relative;
                std::tie(level_there, pull) = describing_closed_forms::lock_pin_at(gap, stiffness, damping,
                    unilateral != 0.0, std::get<0>(there), std::get<1>(there), std::get<2>(there));
                by_mean(by_what, k, e) = (level_there - mean(k, e)) / step;
                change = pull - gain(k, e);
                per = 1.0 / step;
                by_gain(by_what, k, e) = Complex(change.real * per, change.imag * per);
            }
        }
    }
}

/// Bring points to solutions, of some equations for some of their unknowns.
///
/// Parameters
/// ----------
/// X, normal : array, shape (n, 3 m + 1)
///     Points, which are moved, and one more equation where there is one more unknown: the normals of planes.
/// iterations : int
/// limits : tuple of float
///     Relative step of the differences, longest step, that of a point that may be lost, and how many of these in a
///     row; last step of a point that has converged, and the larger of two in a row that are as good.
/// parts : int arrays block, rows, columns
///     Elements, and their equations and unknowns; all that the others give is held.
/// places, pivot, static
///     As of `assemble`.
/// elements : first (m + 1,), arrays of `biased_sinusoid`, pins (m, 7)
///     The maps of all elements, one behind the other, their first breakpoints, and gap, stiffness, damping and whether
///     it only pushes of each that is a lock pin, zeros for the others; the area of a hysteresis loop over pi; rate and
///     bandwidth of a law that limits a rate.
/// linear : arrays, shapes (n, n), (n, m), (m, n), (m, m)
///     State space from all outputs to the first inputs.
/// L : complex array, shape (n, m, m)
///     Its responses, where the amplitude of the pivot and omega are held; else of length zero.
/// around : complex array, shape (n,)
///     Is filled with the gain once around the loop, cut at the pivot's input, where these responses are given.
/// jacobian, found : array and bool array, shapes (n or 1, 3 m, 3 m + 1), (n,)
///     Are filled: that with which a point has made its last step, and whether it has converged. A single Jacobian is
///     workspace. Before, `found` says which points are to be moved.
void newton(Matrix X, Matrix normal, i64 iterations, const std::tuple<double, double, double, double, double,
    double>& limits, const std::tuple<Indices, Indices, Indices>& parts, Indices places, i64 pivot,
    const std::tuple<Matrix, Matrix, Vector>& static_, const std::tuple<Indices, std::tuple<Vector, Vector, Vector,
    Vector>, Matrix>& elements, const std::tuple<Matrix, Matrix, Matrix, Matrix>& linear, ComplexMatrices L,
    ComplexVector around, Matrices jacobian, Flags found) {
    Scope scope;
    double relative{}, longest{}, far{}, most{}, tolerance{}, as_good{}, omega{}, length{};
    Indices block{}, rows{}, columns{}, todo{}, of{};
    Matrix A{}, B{}, C{}, D{}, shapes{}, J{};
    i64 count{}, k{};
    bool regular{}, sound{}, alive{}, small{};
    ComplexMatrix here{}, slope{};
    Vector x{};
    std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices> of_elements{};
    std::tie(relative, longest, far, most, tolerance, as_good) = limits;
    std::tie(block, rows, columns) = parts;
    std::tie(A, B, C, D) = linear;
    i64 m = places.size();
    i64 n = A.shape(0);
    bool free = L.shape(0) == 0;
    ComplexMatrix still = empty<Complex>(0, 0);
    Indices every = counted(m);
    Vector R = empty<double>(3 * m);
    Vector step = empty<double>(3 * m + 1);
    Matrix matrix = balances::room_for(columns.size());
    View<Complex, 4> answer = empty<Complex>(2, 1, m, m);
    std::tuple<ComplexMatrix, Indices, ComplexMatrix> room = responses::room_for_answers(n, m);
    i64 most_points = least_of<i64>(X.shape(0), AT_ONCE);
    Matrix row = empty<double>(6, most_points);
    ComplexMatrix inputs = empty<Complex>(most_points, m);
    Matrix mean = empty<double>(most_points, m);
    ComplexMatrix gain = empty<Complex>(most_points, m);
    Matrices by_mean = empty<double>(3, most_points, m);
    ComplexMatrices by_gain = empty<Complex>(3, most_points, m);
    shapes = newton::shapes(std::get<0>(elements), std::get<1>(elements));
    Indices points = empty<i64>(most_points);
    Flags settled = empty<bool>(most_points);
    Vector lost = empty<double>(most_points);
    for (i64 begin = 0; begin < X.shape(0); begin += AT_ONCE) {
        count = 0;
        for (i64 i = begin, i_end = least_of<i64>(begin + AT_ONCE, X.shape(0)); i < i_end; ++i) {
            if (found(i) && !X.row(i).any([](double one) { return !std::isfinite(one); })) {
                points(count) = i;
                count += 1;
            }
            found(i) = false;
            settled(i - begin) = false;
            lost(i - begin) = 0.0;
        }
        for (i64 turn = 0; turn < iterations; ++turn) {
            if (count == 0) {
                break;
            }
            todo = points.slice(0, count);
            count = 0;
            of = turn ? block : every;
            of_elements = std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>{mean, gain, by_mean, by_gain};
            describe(X, todo, begin, of, places, pivot, relative, elements, shapes, free, row, inputs, of_elements);
            for (const auto& i : todo) {
                x = X.row(i);
                k = i - begin;
                J = jacobian.row((jacobian.shape(0) > 1) ? i : 0);
                if (free) {
                    omega = std::exp(x(1));
                    responses::answer_at(A, B, C, Complex(0.0, omega), Complex(0.0, 1.0), room, answer.cut(ALL, 0, ALL,
                        ALL));
                    for (i64 r = 0; r < m; ++r) {
                        for (i64 c = 0; c < m; ++c) {
                            answer(0, 0, r, c) += D(r, c);
                            answer(1, 0, r, c) *= omega;
                        }
                    }
                }
                std::tie(here, slope) = free ? std::tuple<ComplexMatrix, ComplexMatrix>{answer.row(0, 0), answer.row(1,
                    0)} : std::tuple<ComplexMatrix, ComplexMatrix>{L.row(i), still};
                balances::balance_at(x, k, block, places, every, pivot, static_, of_elements, inputs, here, slope, J,
                    R);
                regular = balances::solve_at(J, R, rows, columns, normal.row(i), 0.0, matrix, step);
                std::tie(length, sound) = balances::move_at(x, columns, places, step, longest);
                lost(k) = (length > far) ? lost(k) + 1.0 : 0.0;
                alive = regular && sound && lost(k) < most;
                small = regular && length < as_good;
                found(i) = alive && ((regular && length < tolerance) || (small && settled(k)));
                settled(k) = small;
                if (found(i) && !free) {
                    around(i) = Complex(0.0, 0.0);
                    for (i64 j = 0; j < m; ++j) {
                        around(i) += here(pivot, j) * gain(k, j) * inputs(k, j) / inputs(k, pivot);
                    }
                }
                if (alive && !found(i)) {
                    points(count) = i;
                    count += 1;
                }
            }
        }
    }
}

}  // namespace newton
}  // namespace EPP_ARCH
}  // namespace epp
