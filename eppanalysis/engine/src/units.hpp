#pragma once
// Units of states in which rows and columns of a matrix are alike.

#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace units {

/// Least and greatest number whose reciprocal, and whose double or half, is an ordinary one.
constexpr double LEAST = 2.0 * (std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon());
constexpr double MOST = 1.0 / LEAST;
/// Share of their sum to which a row and a column must shrink for a change of units to count.
constexpr double WORTH = 0.95;

void even_out(Matrix A, Vector sizes);

}  // namespace units
}  // namespace EPP_ARCH
}  // namespace epp
