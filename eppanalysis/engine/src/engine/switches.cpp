#include "engine/switches.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Input of an element (its row among all) at state x.
double input_at(const Combinations& compiled, i64 q, i64 row, Vector x, Vector H, Matrix Sg, i64 last, double u) {
    double c{};
    double v = 0.0;
    for (i64 i = 0, i_end = compiled.Zx.shape(2); i < i_end; ++i) {
        v += compiled.Zx(q, row, i) * x(i);
    }
    for (i64 j = 0; j < H.size(); ++j) {
        v += compiled.ZH(q, row, j) * H(j);
    }
    for (i64 j = 0; j < Sg.shape(1); ++j) {
        c = compiled.Zs(q, row, j);
        if (c != 0.0) {
            v += c * smooth_at(Sg, last, j, u);
        }
    }
    return v;
}

/// Impulse of the first output of guard k's element at its event.
double impulse(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector H, Matrix Sg, i64 last,
    double u) {
    double c{};
    double v = 0.0;
    i64 z0 = model.first(model.guard_element(k), 0);
    for (i64 b = 0, b_end = model.guard_impulse.shape(1); b < b_end; ++b) {
        c = model.guard_impulse(k, b);
        if (c != 0.0) {
            v += c * input_at(compiled, q, z0 + b, x, H, Sg, last, u);
        }
    }
    return v;
}

/// Whether states jump at guard k's event.
bool jumps_state(const Model& model, i64 k) {
    for (i64 b = 0, b_end = model.guard_impulse.shape(1); b < b_end; ++b) {
        if (model.guard_impulse(k, b) != 0.0) {
            return true;
        }
    }
    return false;
}

}  // namespace EPP_ARCH
}  // namespace epp
