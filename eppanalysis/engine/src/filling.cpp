#include "filling.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace filling {

/// out[:] = source, for vectors.
void fill(Vector out, Vector source) {
    for (i64 i = 0; i < out.size(); ++i) {
        out(i) = source(i);
    }
}

/// out[:] = source, for vectors.
void fill(Indices out, Indices source) {
    for (i64 i = 0; i < out.size(); ++i) {
        out(i) = source(i);
    }
}

/// out[:] = source, for vectors.
void fill(Strided<double, 1> out, Vector source) {
    for (i64 i = 0; i < out.size(); ++i) {
        out(i) = source(i);
    }
}

/// out[:, :] = source, for matrices.
void fill_rows(Strided<double, 2> out, Matrix source) {
    for (i64 i = 0; i < out.shape(0); ++i) {
        fill(out.row(i), source.row(i));
    }
}

/// out[:, :] = source, for matrices.
void fill_rows(Matrix out, Matrix source) {
    for (i64 i = 0; i < out.shape(0); ++i) {
        fill(out.row(i), source.row(i));
    }
}

/// out += factor * source, for vectors.
void accumulate(Vector out, double factor, Vector source) {
    for (i64 i = 0; i < out.size(); ++i) {
        out(i) += factor * source(i);
    }
}

/// Largest absolute value in a matrix; not a number where one is none.
double largest(Matrix rows) {
    double size{};
    double found = 0.0;
    for (i64 i = 0; i < rows.shape(0); ++i) {
        for (i64 j = 0; j < rows.shape(1); ++j) {
            size = std::fabs(rows(i, j));
            if (size > found || size != size) {
                found = size;
            }
        }
    }
    return found;
}

/// Largest absolute value in a matrix; not a number where one is none.
double largest(Strided<double, 2> rows) {
    double size{};
    double found = 0.0;
    for (i64 i = 0; i < rows.shape(0); ++i) {
        for (i64 j = 0; j < rows.shape(1); ++j) {
            size = std::fabs(rows(i, j));
            if (size > found || size != size) {
                found = size;
            }
        }
    }
    return found;
}

/// out += factor * source, for vectors.
void accumulate(Strided<double, 1> out, double factor, Vector source) {
    for (i64 i = 0; i < out.size(); ++i) {
        out(i) += factor * source(i);
    }
}

}  // namespace filling
}  // namespace EPP_ARCH
}  // namespace epp
