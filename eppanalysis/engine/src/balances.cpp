#include "balances.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace balances {

/// Workspace for a linear system: its matrix, the right side as one column more.
Matrix room_for(i64 size) {
    return zeros<double>(size, size + 1);
}

/// Rows and columns of a linear system, and its border, each divided by its largest entry; False if one is zeros.
bool take(Matrix J, Vector R, Indices rows, Indices columns, Vector border, double edge, Matrix matrix) {
    double size{}, value{}, share{};
    bool own{};
    i64 n = columns.size();
    for (i64 r = 0; r < n; ++r) {
        size = 0.0;
        own = r < rows.size();
        matrix(r, n) = own ? R(rows(r)) : edge;
        for (i64 c = 0; c < n; ++c) {
            value = own ? J(rows(r), columns(c)) : border(columns(c));
            matrix(r, c) = value;
            size = greatest_of(size, std::fabs(value));
        }
        // What is not a number, or infinite, is found in the solution.
        if (!(size > 0.0)) {
            return false;
        }
        share = 1.0 / size;
        for (i64 c = 0, c_end = n + 1; c < c_end; ++c) {
            matrix(r, c) *= share;
        }
    }
    return true;
}

/// Bring a linear system to an upper triangle, with the largest entry of each column as its pivot.
///
/// What is left of the triangle is not cleared.
void eliminate(Matrix matrix) {
    i64 best{};
    double most{}, size{}, share{}, factor{};
    i64 n = matrix.shape(0);
    i64 width = matrix.shape(1);
    for (i64 k = 0; k < n; ++k) {
        best = k;
        most = std::fabs(matrix(k, k));
        for (i64 r = k + 1; r < n; ++r) {
            size = std::fabs(matrix(r, k));
            if (size > most) {
                best = r;
                most = size;
            }
        }
        if (best != k) {
            for (i64 c = k; c < width; ++c) {
                {
                    const double was1 = matrix(best, c);
                    const double was2 = matrix(k, c);
                    matrix(k, c) = was1;
                    matrix(best, c) = was2;
                }
            }
        }
        if (matrix(k, k) == 0.0) {
            matrix(k, k) = SINGULAR;
        }
        share = 1.0 / matrix(k, k);
        for (i64 r = k + 1; r < n; ++r) {
            factor = matrix(r, k) * share;
            if (factor != 0.0) {
                for (i64 c = k + 1; c < width; ++c) {
                    matrix(r, c) -= factor * matrix(k, c);
                }
            }
        }
    }
}

/// One of the systems of `solve`, in a matrix from `room_for`; returns whether it is regular.
bool solve_at(Matrix J, Vector R, Indices rows, Indices columns, Vector border, double edge, Matrix matrix,
    Vector step) {
    double value{};
    step.fill(0.0);
    if (!take(J, R, rows, columns, border, edge, matrix)) {
        return false;
    }
    eliminate(matrix);
    i64 n = columns.size();
    bool regular = true;
    for (i64 k = n - 1; k > -1; --k) {
        value = matrix(k, n) / matrix(k, k);
        // Taken from all rows above at once, no sum waits for its last product.
        for (i64 r = 0; r < k; ++r) {
            matrix(r, n) -= matrix(r, k) * value;
        }
        step(columns(k)) = value;
        regular = regular && std::isfinite(value);
    }
    if (!regular) {
        step.fill(0.0);
    }
    return regular;
}

/// Inputs of n points, and the same with amplitude, bias and frequency shifted.
///
/// Parameters
/// ----------
/// X : array, shape (n, 3 m + 1)
///     Unknowns.
/// places, of_outputs : int array, shapes (m,), (nw,)
///     Of the balance: places of amplitudes, owners of outputs.
/// pivot : int
/// relative : float
///     Step, in units of the amplitude and of the frequency.
/// inputs : complex array, shape (n, m)
///     Phasors, which are filled as the next ones are.
/// a, b, omega : arrays, shapes (m, 4, n), (m, 4, n), (4, n)
///     Along the second axis: as it is, then with its amplitude, its bias and the frequency shifted.
/// steps : array, shape (3, n, nw)
///     By how much, for the element that owns an output.
void shift(Matrix X, Indices places, i64 pivot, Indices of_outputs, double relative, ComplexMatrix inputs, Matrices a,
    Matrices b, Matrix omega, Matrices steps) {
    i64 e{};
    double size{}, mean{}, phase{};
    i64 m = places.size();
    for (i64 i = 0; i < X.shape(0); ++i) {
        for (i64 e_at = 0; e_at < m; ++e_at) {
            e = e_at;
            size = std::exp(X(i, places(e)));
            mean = X(i, 2 * m + e);
            phase = (e != pivot) ? X(i, places(e) + 1) : 0.0;
            inputs(i, e) = Complex(size * std::cos(phase), size * std::sin(phase));
            for (i64 k = 0; k < 4; ++k) {
                a(e, k, i) = size;
                b(e, k, i) = mean;
            }
            a(e, 1, i) = size * (1.0 + relative);
            b(e, 2, i) = mean + (relative * size + 1e-12 * std::fabs(mean));
        }
        for (i64 k = 0; k < 4; ++k) {
            omega(k, i) = std::exp(X(i, 1));
        }
        omega(3, i) *= 1.0 + relative;
        for (i64 j = 0; j < of_outputs.size(); ++j) {
            e = of_outputs(j);
            // The step that is really made: of a small one beside a large bias rounding changes the size.
            {
                const double was1 = relative;
                const double was2 = greatest_of(b(e, 2, i) - b(e, 0, i), 1e-290);
                const double was3 = relative;
                steps(0, i, j) = was1;
                steps(1, i, j) = was2;
                steps(2, i, j) = was3;
            }
        }
    }
}

/// Residual and Jacobian of one point and a block of elements, of what all elements give the share of number k.
///
/// Other arguments are its shares of those of `assemble`.
void balance_at(Vector x, i64 k, Indices block, Indices places, Indices owner, i64 pivot, const std::tuple<Matrix,
    Matrix, Vector>& static_, const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements,
    ComplexMatrix inputs, ComplexMatrix L, ComplexMatrix dL, Matrix J, Vector R) {
    Matrix on_bias{}, on_mean{}, mean{};
    Vector prescribed{};
    ComplexMatrix gain{};
    Matrices by_mean{};
    ComplexMatrices by_gain{};
    i64 i{}, s{}, o{}, place{};
    Complex z{}, total{}, turned{}, response{}, loop{}, by{};
    double front{}, off{}, share{};
    std::tie(on_bias, on_mean, prescribed) = static_;
    std::tie(mean, gain, by_mean, by_gain) = of_elements;
    i64 m = places.size();
    bool moves = dL.shape(0) > 0;
    // Entries by their indices: a row as an array of its own takes longer than what is done with it.
    for (const auto& r : block) {
        i = m + r;
        s = 2 * m + r;
        for (i64 c = 0, c_end = 3 * m + 1; c < c_end; ++c) {
            J(r, c) = 0.0;
            J(i, c) = 0.0;
            J(s, c) = 0.0;
        }
        // By its conjugate: the division that guards against overflow takes as long as all the rest.
        z = inputs(k, r);
        front = ((r == pivot) ? std::exp(x(3 * m)) : 1.0) / (z.real * z.real + z.imag * z.imag);
        total = Complex(0.0, 0.0);
        off = -prescribed(r);
        for (i64 j = 0; j < owner.size(); ++j) {
            o = owner(j);
            share = on_mean(r, j);
            place = places(o);
            if (share != 0.0) {
                off += share * mean(k, j);
                J(s, place) += share * by_mean(0, k, j);
                J(s, 2 * m + o) += share * by_mean(1, k, j);
                if (moves) {
                    J(s, 1) += share * by_mean(2, k, j);
                }
            }
            // Of the few outputs of a loop fewer yet act on an input.
            if (L(r, j) == 0.0 && !(moves && dL(r, j) != 0.0)) {
                continue;
            }
            // Relative to the input that the response is for.
            turned = inputs(k, o) * Complex(front * z.real, -front * z.imag);
            response = L(r, j) * turned;
            loop = response * gain(k, j);
            total += loop;
            // By the logarithm of an amplitude and by a phase an output changes by itself, and by itself times j:
            // what the slope of the gain adds is all that has to be differenced (docs/theory/index.md, Several
            // elements).
            if (o != pivot) {
                J(r, place + 1) -= loop.imag;
                J(i, place + 1) += loop.real;
            }
            by = response * by_gain(0, k, j) + loop;
            J(r, place) += by.real;
            J(i, place) += by.imag;
            by = response * by_gain(1, k, j);
            J(r, 2 * m + o) += by.real;
            J(i, 2 * m + o) += by.imag;
            if (moves) {
                by = response * by_gain(2, k, j) + dL(r, j) * turned * gain(k, j);
                J(r, 1) += by.real;
                J(i, 1) += by.imag;
            }
        }
        J(r, places(r)) -= total.real;
        J(i, places(r)) -= total.imag;
        if (r == pivot) {
            J(r, 3 * m) = total.real;
            J(i, 3 * m) = total.imag;
        } else {
            J(r, places(r) + 1) += total.imag;
            J(i, places(r) + 1) -= total.real;
        }
        for (i64 e = 0; e < m; ++e) {
            off += on_bias(r, e) * x(2 * m + e);
            J(s, 2 * m + e) += on_bias(r, e);
        }
        R(r) = total.real - 1.0;
        R(i) = total.imag;
        R(s) = off;
    }
}

/// Fill the residuals R (n, 3 m) and Jacobians J (n, 3 m, 3 m + 1) of n balances.
///
/// Parameters
/// ----------
/// X, places, owner, pivot, inputs
///     As of `shift`.
/// static : arrays on_bias (m, m), on_mean (m, nw), prescribed (m,)
///     Balance of the means.
/// of_elements : arrays mean (n, nw), gain (n, nw), by_mean (3, n, nw), by_gain (3, n, nw)
///     With their slopes by logarithm of the amplitude, bias and logarithm of the frequency.
/// L, dL : complex array, shapes (n, m, nw)
///     Responses of the linear part and their derivatives by ln omega; none of these, (0, m, nw), where omega is held
///     still.
void assemble(Matrix X, Indices places, Indices owner, i64 pivot, const std::tuple<Matrix, Matrix, Vector>& static_,
    const std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>& of_elements, ComplexMatrix inputs,
    ComplexMatrices L, ComplexMatrices dL, Matrices J, Matrix R) {
    Scope scope;
    ComplexMatrix slope{};
    Indices every = counted(places.size());
    ComplexMatrix none = empty<Complex>(0, 0);
    for (i64 i = 0; i < R.shape(0); ++i) {
        slope = dL.shape(0) ? dL.row(i) : none;
        balance_at(X.row(i), i, every, places, owner, pivot, static_, of_elements, inputs, L.row(i), slope, J.row(i),
            R.row(i));
    }
}

/// Inputs of all elements but the pivot, for given gains and input of the pivot: linear equations.
///
/// Parameters
/// ----------
/// L : complex array, shape (n, m, nw)
///     Response of the linear part.
/// gains : complex array, shape (n, nw)
/// owner, others : int array, shapes (nw,), (m - 1,)
///     Element of each output, and all elements but the pivot.
/// pivot : int
/// inputs : complex array, shape (n, m)
///     Phasors, of which those of the others are filled.
void drive(ComplexMatrices L, ComplexMatrix gains, Indices owner, Indices others, i64 pivot, ComplexMatrix inputs) {
    Scope scope;
    i64 c{}, best{};
    Complex loop{}, factor{};
    i64 n = others.size();
    Indices place = full<i64>(n, n + 1);
    ComplexMatrix matrix = empty<Complex>(n, n + 1);
    for (i64 k = 0; k < n; ++k) {
        place(others(k)) = k;
    }
    for (i64 i = 0; i < L.shape(0); ++i) {
        matrix.fill(0.0);
        for (i64 r = 0; r < n; ++r) {
            matrix(r, r) = 1.0;
            for (i64 j = 0; j < owner.size(); ++j) {
                c = place(owner(j));
                loop = L(i, others(r), j) * gains(i, j);
                matrix(r, c) += (c == n) ? loop * inputs(i, pivot) : -loop;
            }
        }
        for (i64 k = 0; k < n; ++k) {
            std::tie(best, std::ignore) = responses::pivot_row(matrix, k);
            for (i64 c_at = k, c_at_end = n + 1; c_at < c_at_end; ++c_at) {
                c = c_at;
                {
                    const Complex was1 = matrix(best, c);
                    const Complex was2 = matrix(k, c);
                    matrix(k, c) = was1;
                    matrix(best, c) = was2;
                }
            }
            for (i64 r = 0; r < n; ++r) {
                factor = matrix(r, k) / matrix(k, k);
                if (r != k && factor != 0.0) {
                    for (i64 c_at = k + 1, c_at_end = n + 1; c_at < c_at_end; ++c_at) {
                        c = c_at;
                        matrix(r, c) -= factor * matrix(k, c);
                    }
                }
            }
        }
        for (i64 k = 0; k < n; ++k) {
            inputs(i, others(k)) = matrix(k, n) / matrix(k, k);
        }
    }
}

/// Solve n linear systems for some of their columns; those that are not finite give zeros and False.
///
/// Parameters
/// ----------
/// J, R : array, shapes (n, r, c), (n, r)
///     Left and right sides.
/// rows, columns : int array, shapes (k,), (k,) or (k + 1,)
///     Those that are taken.
/// border : array, shape (n, c)
///     One more row where there is one more column, with `edge` on its right side.
/// step, regular : array and bool array, shapes (n, c), (n,)
///     Are filled; zeros in columns that are not taken.
void solve(Matrices J, Matrix R, Indices rows, Indices columns, Matrix border, double edge, Matrix step,
    Flags regular) {
    Scope scope;
    Matrix matrix = room_for(columns.size());
    for (i64 i = 0; i < R.shape(0); ++i) {
        regular(i) = solve_at(J.row(i), R.row(i), rows, columns, border.row(i), edge, matrix, step.row(i));
    }
}

/// One of the steps of `move`, in some columns; returns its whole length and whether the point is sound.
std::tuple<double, bool> move_at(Vector x, Indices columns, Indices places, Vector step, double longest) {
    double size{};
    i64 m = places.size();
    double length = 0.0;
    double far = 0.0;
    for (const auto& c : columns) {
        size = (c == (3 * m)) ? 3.0 : 1.0;
        if ((2 * m) <= c && c < (3 * m)) {
            size = std::exp(x(places(c - 2 * m))) + 0.1 * std::fabs(x(c));
        }
        length = greatest_of(length, std::fabs(step(c)) / size);
    }
    double share = least_of(1.0, longest / greatest_of(length, 1e-300));
    for (const auto& c : columns) {
        x(c) -= step(c) * share;
        far = (c < (2 * m)) ? greatest_of(far, std::fabs(x(c))) : far;
        far = std::isfinite(x(c)) ? far : INF;
    }
    return {length, far < FAR};
}

/// Take steps from points, shortened to the longest that is allowed.
///
/// Parameters
/// ----------
/// X, step : array, shape (n, 3 m + 1)
///     Points, which are moved.
/// places : int array, shape (m,)
///     As of `shift`.
/// longest : float
///     In logarithms, where a step is a factor; in phases; in biases relative to the amplitude.
/// largest, sound : array and bool array, shape (n,)
///     Are filled: lengths of the whole steps, and whether a point has numbers that can be worked with.
void move(Matrix X, Indices places, Matrix step, double longest, Vector largest, Flags sound) {
    Scope scope;
    Indices every = counted(X.shape(1));
    for (i64 i = 0; i < X.shape(0); ++i) {
        std::tie(largest(i), sound(i)) = move_at(X.row(i), every, places, step.row(i), longest);
    }
}

}  // namespace balances
}  // namespace EPP_ARCH
}  // namespace epp
