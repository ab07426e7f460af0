#include "responses.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace responses {

/// Workspace for a matrix, its pivots, and the states that w inputs bring about.
std::tuple<ComplexMatrix, Indices, ComplexMatrix> room_for_answers(i64 n, i64 w) {
    return {empty<Complex>(n, n), empty<i64>(n), empty<Complex>(n, w)};
}

/// Fill a matrix with ``s + j beside - A``.
void subtracted(Matrix A, Complex s, double beside, ComplexMatrix matrix) {
    i64 n = A.shape(0);
    for (i64 r = 0; r < n; ++r) {
        for (i64 c = 0; c < n; ++c) {
            matrix(r, c) = Complex(-A(r, c), 0.0);
        }
        matrix(r, r) += s + Complex(0.0, beside);
    }
}

/// Row, from k on, with the largest entry in column k of a complex matrix, and the size of that.
std::tuple<i64, double> pivot_row(ComplexMatrix matrix, i64 k) {
    double size{};
    i64 best = k;
    double most = -1.0;
    for (i64 r = k; r < matrix.shape(0); ++r) {
        size = std::fabs(matrix(r, k).real) + std::fabs(matrix(r, k).imag);
        if (size > most) {
            best = r;
            most = size;
        }
    }
    return {best, most};
}

/// Bring a matrix to its triangular factors, with pivots inverted, by rows; False where one is zero.
bool factored(ComplexMatrix matrix, Indices pivots) {
    i64 best{};
    double most{};
    Complex factor{};
    i64 n = pivots.size();
    for (i64 k = 0; k < n; ++k) {
        std::tie(best, most) = pivot_row(matrix, k);
        pivots(k) = best;
        if (!(most > 0.0)) {
            return false;
        }
        if (best != k) {
            for (i64 c = 0; c < n; ++c) {
                {
                    const Complex was1 = matrix(best, c);
                    const Complex was2 = matrix(k, c);
                    matrix(k, c) = was1;
                    matrix(best, c) = was2;
                }
            }
        }
        matrix(k, k) = 1.0 / matrix(k, k);
        for (i64 r = k + 1; r < n; ++r) {
            if (matrix(r, k) != 0.0) {
                factor = matrix(r, k) * matrix(k, k);
                matrix(r, k) = factor;
                for (i64 c = k + 1; c < n; ++c) {
                    matrix(r, c) -= factor * matrix(k, c);
                }
            }
        }
    }
    return true;
}

/// Rounding of the largest entry of ``s - A``.
double beside(Matrix A, Complex s) {
    Complex entry{};
    double size = 0.0;
    for (i64 r = 0; r < A.shape(0); ++r) {
        for (i64 c = 0; c < A.shape(0); ++c) {
            entry = ((r == c) ? s : Complex(0.0)) - A(r, c);
            size = greatest_of(greatest_of(size, std::fabs(entry.real)), std::fabs(entry.imag));
        }
    }
    return whole_power(2.0, -52) * ((size > 0.0) ? size : 1.0);
}

/// Solve for the columns of x by the factors of a matrix.
void substitute(ComplexMatrix matrix, Indices pivots, ComplexMatrix x) {
    i64 r{}, first{}, end{};
    Complex factor{};
    i64 n = x.shape(0);
    i64 w = x.shape(1);
    for (i64 k = 0; k < n; ++k) {
        if (pivots(k) != k) {
            for (i64 j = 0; j < w; ++j) {
                {
                    const Complex was1 = x(pivots(k), j);
                    const Complex was2 = x(k, j);
                    x(k, j) = was1;
                    x(pivots(k), j) = was2;
                }
            }
        }
    }
    for (i64 k = 0, k_end = 2 * n; k < k_end; ++k) {
        r = (k < n) ? k : 2 * n - 1 - k;
        std::tie(first, end) = (k < n) ? std::tuple<i64, i64>{0, r} : std::tuple<i64, i64>{r + 1, n};
        for (i64 c = first; c < end; ++c) {
            factor = matrix(r, c);
            if (factor != 0.0) {
                for (i64 j = 0; j < w; ++j) {
                    x(r, j) -= factor * x(c, j);
                }
            }
        }
        if (k >= n) {
            for (i64 j = 0; j < w; ++j) {
                x(r, j) *= matrix(r, r);
            }
        }
    }
}

/// One of the answers of `response_and_slope`, with workspace from `room_for_answers`.
void answer_at(Matrix A, Matrix B, Matrix C, Complex s, Complex ds, const std::tuple<ComplexMatrix, Indices,
    ComplexMatrix>& room, Strided<Complex, 3> out) {
    ComplexMatrix matrix{}, x{};
    Indices pivots{};
    double share{};
    std::tie(matrix, pivots, x) = room;
    i64 n = B.shape(0);
    i64 w = B.shape(1);
    subtracted(A, s, 0.0, matrix);
    if (!factored(matrix, pivots)) {
        subtracted(A, s, beside(A, s), matrix);
        factored(matrix, pivots);
    }
    for (i64 turn = 0; turn < out.shape(0); ++turn) {
        for (i64 r = 0; r < n; ++r) {
            // The derivative of the resolvent is its square.
            for (i64 j = 0; j < w; ++j) {
                x(r, j) = turn ? -ds * x(r, j) : Complex(B(r, j), 0.0);
            }
        }
        substitute(matrix, pivots, x);
        for (i64 r = 0; r < C.shape(0); ++r) {
            for (i64 j = 0; j < w; ++j) {
                out(turn, r, j) = Complex(0.0, 0.0);
            }
            for (i64 c = 0; c < n; ++c) {
                share = C(r, c);
                if (share != 0.0) {
                    for (i64 j = 0; j < w; ++j) {
                        out(turn, r, j) += Complex(share * x(c, j).real, share * x(c, j).imag);
                    }
                }
            }
        }
    }
}

/// Fill `out` with ``C (s - A)^-1 B``, and then with its derivative by what s has the derivative ds by.
///
/// At a pole to the last bit both are those a rounding beside it.
///
/// Parameters
/// ----------
/// A, B, C : arrays, shapes (n, n), (n, w), (z, n)
/// s, ds : complex array, shape (k,)
/// out : complex array, shape (1 or 2, k, z, w)
void response_and_slope(Matrix A, Matrix B, Matrix C, ComplexVector s, ComplexVector ds, View<Complex, 4> out) {
    Scope scope;
    std::tuple<ComplexMatrix, Indices, ComplexMatrix> room = room_for_answers(B.shape(0), B.shape(1));
    for (i64 i = 0; i < s.size(); ++i) {
        answer_at(A, B, C, s(i), ds(i), room, out.cut(ALL, i, ALL, ALL));
    }
}

}  // namespace responses
}  // namespace EPP_ARCH
}  // namespace epp
