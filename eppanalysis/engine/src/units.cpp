#include "units.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace units {

/// Euclidean length and largest size of a row or a column.
std::tuple<double, double> measure(Strided<double, 1> a) {
    double largest = 0.0, total = 0.0;
    for (i64 i = 0; i < a.size(); ++i) largest = greatest_of(largest, std::fabs(a(i)));
    if (largest == 0.0) return {0.0, 0.0};
    // In units of a power of two squares neither overflow nor vanish, and nothing is rounded.
    const int power = std::ilogb(largest);
    for (i64 i = 0; i < a.size(); ++i) {
        const double share = std::ldexp(a(i), -power);
        total += share * share;
    }
    return {std::ldexp(std::sqrt(total), power), largest};
}

/// Bring a matrix into units of its states, powers of two, in which its rows are as long as its columns, to a factor of
/// two (James, Langou and Lowery 2014); `sizes` (n,) are filled with the units.
void even_out(Matrix A, Vector sizes) {
    sizes.fill(1.0);
    for (bool again = true; again;) {
        again = false;
        for (i64 i = 0; i < sizes.size(); ++i) {
            auto [column, in_column] = measure(A.cut(ALL, i));
            auto [row, in_row] = measure(A.cut(i, ALL));
            if (column == 0.0 || row == 0.0) continue;
            const double before = column + row;
            double unit = 1.0;
            const auto change = [&](double by) {
                unit *= by;
                column *= by;
                in_column *= by;
                row /= by;
                in_row /= by;
            };
            while (column < row / 2.0 && greatest_of(greatest_of(unit, column), in_column) < MOST &&
                   least_of(row / 2.0, in_row) > LEAST)
                change(2.0);
            while (column / 2.0 >= row && greatest_of(row, in_row) < MOST &&
                   least_of(least_of(unit, column / 2.0), in_column) > LEAST)
                change(0.5);
            const double whole = sizes(i) * unit;
            if (column + row >= WORTH * before || !(whole > LEAST / 2.0 && whole < 2.0 * MOST)) continue;
            sizes(i) = whole;
            again = true;
            for (i64 k = 0; k < sizes.size(); ++k) A(i, k) /= unit;
            for (i64 k = 0; k < sizes.size(); ++k) A(k, i) *= unit;
        }
    }
}

}  // namespace units
}  // namespace EPP_ARCH
}  // namespace epp
