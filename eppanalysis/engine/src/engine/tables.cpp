#include "engine/tables.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Set the rows of combination q to zero that are longer than what they hold.
void clear(const Combinations& compiled, i64 q) {
    compiled.M.row(q).fill(0.0);
    compiled.M_twice.row(q).fill(0.0);
    compiled.M_size.row(q).fill(0.0);
    compiled.Y.row(q).fill(0.0);
    compiled.ga.row(q).fill(0.0);
    compiled.ga_size.row(q).fill(0.0);
    compiled.gb.row(q).fill(0.0);
    compiled.gb_size.row(q).fill(0.0);
    compiled.gf.row(q).fill(0.0);
    compiled.all_gf.row(q).fill(0.0);
    compiled.reach_gf.row(q).fill(0.0);
    compiled.T.row(q).fill(0.0);
    compiled.bound.row(q).fill(0.0);
    compiled.T_long.row(q).fill(0.0);
    compiled.reach.row(q).fill(0.0);
}

}  // namespace EPP_ARCH
}  // namespace epp
