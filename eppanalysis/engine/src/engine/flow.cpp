#include "engine/flow.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// out = scale P Q for small matrices, padded (no BLAS: its threads cost more than the product).
void multiply(Matrix P, Matrix Q, double scale, Matrix out) {
    for (i64 i = 0; i < P.shape(0); ++i) {
        row_sum(Q, P.row(i), scale, out.row(i));
    }
}

void _copy(Matrix out, Matrix source) {
    for (i64 i = 0; i < out.shape(0); ++i) {
        take(out.row(i), source.row(i));
    }
}

/// Bound on the growth of the powers of M (padded): the 32nd root of the norm of its 32nd power [1/s].
double growth_rate(Matrix M, Matrix P, Matrix Q) {
    double norm{};
    i64 n = M.shape(0);
    double size = 0.0;
    for (i64 i = 0; i < n; ++i) {
        size += dot(M.row(i), M.row(i));
    }
    if (size == 0.0) {
        return 0.0;
    }
    // A norm of M itself may exceed the growth by orders where states differ in scale, and would shorten all steps.
    _copy(P, M);
    double log_scale = 0.5 * std::log(size);
    double scale = 1.0 / size;
    for (i64 turn_ = 0; turn_ < 5; ++turn_) {
        multiply(P, P, scale, Q);
        {
            const Matrix was1 = Q;
            const Matrix was2 = P;
            P = was1;
            Q = was2;
        }
        norm = 0.0;
        for (i64 i = 0; i < n; ++i) {
            norm += dot(P.row(i), P.row(i));
        }
        if (norm == 0.0) {
            return 0.0;
        }
        log_scale = 2.0 * log_scale + 0.5 * std::log(norm);
        scale = 1.0 / norm;
    }
    return std::exp(log_scale / 32.0);
}

/// Keep a rate matrix by its rows of eight numbers that are not zero, filled up to four at a time.
void _keep_sparse(Matrix M, Matrix entries, Indices row, Indices row_end) {
    i64 first{};
    bool some{};
    i64 k = 0;
    for (i64 block = 0; block < row_end.size(); ++block) {
        first = block * VECTOR_SIZE;
        for (i64 j = 0; j < M.shape(0); ++j) {
            some = false;
            for (i64 i = 0; i < VECTOR_SIZE; ++i) {
                row(k) = j;
                entries(k, i) = M(j, first + i);
                some = some || entries(k, i) != 0.0;
            }
            k += some;
        }
        while ((modulo(k, 4)) > 0) {
            row(k) = 0;
            entries.row(k).fill(0.0);
            k += 1;
        }
        row_end(block) = k;
    }
}

/// Step of combination q: the base step, halved until the mode's motion is resolved; its matrices wait for their
/// use.
void choose_step(const Combinations& compiled, const Work& work, i64 q, double base_step) {
    double far{};
    double rate = growth_rate(compiled.M.row(q), work.square.row(0), work.square.row(1));
    double h = base_step;
    bool sparse = compiled.row_end.shape(1) > 0;
    // At 6 the bound of a fast step, a series in half of it, may be e^3 times what it begins with; what goes by series
    // goes no further than these.
    while ((rate * h) > (sparse ? REACH : 6.0)) {
        h *= 0.5;
    }
    compiled.step(q) = h;
    compiled.rate(q) = rate;
    compiled.ready(q) = 0;
    compiled.longs(q) = 0;
    compiled.far(q) = 0;
    if (sparse) {
        _keep_sparse(compiled.M.row(q), compiled.entries.row(q), compiled.row.row(q), compiled.row_end.row(q));
        _keep_sparse(compiled.Y.row(q), compiled.y_entries.row(q), compiled.y_row.row(q), compiled.y_row_end.row(q));
        compiled.spread_rate(q) = growth_rate(compiled.M_size.row(q), work.square.row(0), work.square.row(1));
        far = ((rate * h * MOST_FAR) <= REACH) ? MOST_FAR * h : REACH / rate;
        // By the numbers that are read: those of M at each order, those of T at each step.
        if (compiled.linear(q) && (ORDERS * VECTOR_SIZE * compiled.row_end(q, compiled.row_end.shape(1) -
            1)) < (far / h * compiled.T.row(q).size())) {
            compiled.far(q) = far;
        }
    }
}

/// out += P.
void _add(Matrix out, Matrix P) {
    for (i64 i = 0; i < P.shape(0); ++i) {
        add(out.row(i), P.row(i));
    }
}

/// Whether a number of the matrix P is above the limit of its column.
bool _any_above(Matrix P, double scale, Vector limits) {
    for (i64 i = 0; i < P.shape(0); ++i) {
        if (any_above(P.row(i), scale, limits)) {
            return true;
        }
    }
    return false;
}

/// exp(M h), its integral over [0, h], and exp(M h/2), into the arrays so named; for M (padded) or its transpose.
void flow(Matrix M, double h, double rate, Matrix integral, Matrix power, Matrix half, Matrix term, Matrix work) {
    i64 n = M.shape(0);
    i64 doublings = 1;
    while ((rate * h / whole_power(2.0, doublings)) > 0.5) {
        doublings += 1;
    }
    // Scaling and squaring: a Taylor series of the integral over a step so short that it needs 21 terms at most.
    double d = h / whole_power(2.0, doublings);
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            const double was1 = (i == j) ? d : 0.0;
            term(i, j) = was1;
            integral(i, j) = was1;
        }
    }
    for (i64 i = 0; i < n; ++i) {
        power(0, i) = 1e-18 * d;
    }
    for (i64 k = 2; k < 22; ++k) {
        multiply(M, term, d / k, work);
        {
            const Matrix was2 = work;
            const Matrix was3 = term;
            term = was2;
            work = was3;
        }
        _add(integral, term);
        if (!_any_above(term, 1.0, power.row(0))) {
            break;
        }
    }
    multiply(M, integral, 1.0, power);
    for (i64 i = 0; i < n; ++i) {
        power(i, i) += 1.0;
    }
    for (i64 k = 0; k < doublings; ++k) {
        if (k == (doublings - 1)) {
            _copy(half, power);
        }
        // Twice the time: what the first half added, carried through the second, is added once more.
        multiply(power, integral, 1.0, work);
        _add(integral, work);
        multiply(power, power, 1.0, work);
        _copy(power, work);
    }
}

/// Columns of T: state increment, rate, guard increments and guard rates at the end of a step.
void _fill_step(Matrix T, Matrix gf, i64 G, Matrix integral, Matrix power) {
    bool own{};
    i64 wide = power.shape(0);
    i64 half = floor_div(T.shape(1) - 2 * wide, 2);
    for (i64 i = 0; i < wide; ++i) {
        for (i64 j = 0; j < wide; ++j) {
            T(i, j) = integral(i, j);
            T(i, wide + j) = power(i, j);
        }
        for (i64 g = 0; g < half; ++g) {
            own = g < G;
            T(i, 2 * wide + g) = own ? dot(integral.row(i), gf.row(g)) : 0.0;
            T(i, 2 * wide + half + g) = own ? dot(power.row(i), gf.row(g)) : 0.0;
        }
    }
}

/// total = sum of abs(M^k P) step^k shift!/(k + shift)! over k; P and Q are overwritten.
void _sizes_of_powers(Matrix M, double step, double shift, Matrix P, Matrix Q, Matrix total) {
    bool grown{};
    for (i64 i = 0; i < P.shape(0); ++i) {
        take_sizes(total.row(i), P.row(i));
    }
    double factor = 1.0;
    for (i64 k = 1; k < 64; ++k) {
        factor *= step / (k + shift);
        multiply(M, P, 1.0, Q);
        {
            const Matrix was1 = Q;
            const Matrix was2 = P;
            P = was1;
            Q = was2;
        }
        grown = k <= 8;
        for (i64 i = 0; i < P.shape(0); ++i) {
            add_sizes(total.row(i), P.row(i), factor);
            grown = grown || any_above(P.row(i), 10000.0 * factor, total.row(i));
        }
        if (!grown) {
            break;
        }
    }
}

/// Fill the matrices that carry state, rate and guards over the step of combination q.
///
/// How far a guard strays from the cubic through its end values is bounded by its fourth derivative over the step,
/// ``gf M^3 exp(M s) x'(0)``, by its series about the middle.
void compile_step(const Combinations& compiled, const Work& work, i64 q) {
    Matrix M = compiled.M.row(q);
    double h = compiled.step(q);
    double rate = compiled.rate(q);
    Matrices a = work.square;
    compiled.ready(q) = 1;
    Matrix integral = a.row(2);
    Matrix power = a.row(3);
    Matrix half = a.row(4);
    flow(M, h, rate, integral, power, half, a.row(5), a.row(6));
    _fill_step(compiled.T.row(q), compiled.gf.row(q), compiled.n_guards(q), integral, power);
    Matrix P = work.guards.row(0);
    Matrix Q = work.guards.row(1);
    // h^4/384 is Hermite's remainder, that of the cubic through end values and end rates; the thousandth covers
    // rounding. The guard's rows take M three times, then exp(M h/2): its fourth derivative in the middle of the step.
    multiply(M, compiled.all_gf.row(q), 1.001 * whole_power(h, 4) / 384.0, P);
    multiply(M, P, 1.0, Q);
    multiply(M, Q, 1.0, P);
    multiply(half, P, 1.0, Q);
    // From the middle the series reaches both ends in half a step, which halves each power of the bound's growth.
    _sizes_of_powers(M, 0.5 * h, 0.0, Q, P, compiled.bound.row(q));
}

/// Fill the matrices of the next longer step of combination q, and the bound on its guards' travel.
void compile_long(const Combinations& compiled, const Work& work, i64 q) {
    double h{};
    i64 n = compiled.N.shape(1);
    i64 level = compiled.longs(q);
    Matrices a = work.square;
    Matrix integral = a.row(2);
    Matrix power = a.row(3);
    Matrix product = a.row(4);
    Matrix T = (level == 0) ? compiled.T.row(q) : compiled.T_long.row(q, level - 1);
    Matrix reach = compiled.reach.row(q, level);
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            integral(i, j) = T(i, j);
            power(i, j) = T(i, power.shape(0) + j);
        }
    }
    Matrix P = work.guards.row(0);
    Matrix Q = work.guards.row(1);
    if (level == 0) {
        h = compiled.step(q);
        for (i64 i = 0; i < power.shape(0); ++i) {
            for (i64 g = 0; g < P.shape(1); ++g) {
                P(i, g) = 1.001 * h * compiled.all_gf(q, i, g);
            }
        }
        _sizes_of_powers(compiled.M.row(q), h, 1.0, P, Q, reach);
    } else {
        _copy(reach, compiled.reach.row(q, level - 1));
    }
    // Twice the time: in its second half a guard travels at most as far from where the sizes of exp(M t) carry the
    // rate (docs/theory/engine.md, Long step).
    for (i64 turn_ = 0; turn_ < LONG_DOUBLINGS; ++turn_) {
        for (i64 i = 0; i < power.shape(0); ++i) {
            take_sizes(product.row(i), power.row(i));
        }
        multiply(product, reach, 1.0, P);
        _add(reach, P);
        multiply(power, integral, 1.0, product);
        _add(integral, product);
        multiply(power, power, 1.0, product);
        _copy(power, product);
    }
    _fill_step(compiled.T_long.row(q, level), compiled.gf.row(q), compiled.n_guards(q), integral, power);
    compiled.longs(q) = level + 1;
}

}  // namespace EPP_ARCH
}  // namespace epp
