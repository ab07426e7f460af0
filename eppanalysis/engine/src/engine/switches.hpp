#pragma once
// The rules of a switch: when a guard counts as risen, and what its element does then.

#include "engine/constants.hpp"
#include "structures.hpp"
#include "engine/modes.hpp"
#include "engine/series.hpp"

namespace epp {
inline namespace EPP_ARCH {

inline double smooth_at(Matrix Sg, i64 last, i64 j, double u);
double input_at(const Combinations& compiled, i64 q, i64 row, Vector x, Vector H, Matrix Sg, i64 last, double u);
inline bool beyond_level(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector recent,
    Vector H, Matrix Sg, i64 last, double u);
double impulse(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector H, Matrix Sg, i64 last,
    double u);
inline void reset(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector H, Matrix Sg,
    i64 last, double u, Indices modes, Vector new_);
inline void settle_on_level(const Model& model, const Combinations& compiled, i64 q, i64 e, Indices modes, Vector x,
    Vector H);
inline i64 switch_(const Model& model, const Combinations& compiled, const Work& work, i64 q, i64 which, bool stays,
    Vector x, Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes, Vector memory, double base_step);
inline void record(const EventBuffer& buffer, i64 r, Vector x, Vector rate, Vector H, Indices modes);
inline double rise_from_start(const Combinations& compiled, i64 q, i64 g, Matrix X, i64 last, Matrix Sg, Vector H,
    double d, Vector recent, double clock, Matrix Y, Vector wide, Vector p, bool forced);
bool jumps_state(const Model& model, i64 k);

/// Smooth channel j at place u of its series.
inline double smooth_at(Matrix Sg, i64 last, i64 j, double u) {
    double v = 0.0;
    for (i64 k = last; k > -1; --k) {
        v = v * u + Sg(k, j);
    }
    return v;
}

/// Whether the input of guard k's element has jumped over the level on which its target would keep it.
inline bool beyond_level(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector recent,
    Vector H, Matrix Sg, i64 last, double u) {
    i64 e = model.guard_element(k);
    i64 m = model.mode_first(e) + model.guard_target(k);
    if (!model.mode_stick(m)) {
        return false;
    }
    i64 z0 = model.first(e, 0);
    double size = std::fabs(model.mode_level(m));
    for (i64 i = 0, i_end = model.C.shape(1); i < i_end; ++i) {
        size += std::fabs(compiled.Zx(q, z0, i)) * greatest_of(std::fabs(x(i)), recent(i));
    }
    return std::fabs(input_at(compiled, q, z0, x, H, Sg, last, u) - model.mode_level(m)) > (1e-09 * size);
}

/// Memory values and mode of the element whose guard k fired.
inline void reset(const Model& model, const Combinations& compiled, i64 q, i64 k, Vector x, Vector H, Matrix Sg,
    i64 last, double u, Indices modes, Vector new_) {
    double v{}, c{};
    i64 e = model.guard_element(k);
    i64 z0 = model.first(e, 0);
    i64 h0 = model.first(e, 2);
    i64 n_ze = model.first(e + 1, 0) - z0;
    i64 n_he = model.first(e + 1, 2) - h0;
    for (i64 a = 0; a < n_he; ++a) {
        v = model.reset_0(k, a);
        for (i64 b = 0; b < n_he; ++b) {
            v += model.reset_h(k, a, b) * H(h0 + b);
        }
        for (i64 b = 0; b < n_ze; ++b) {
            c = model.reset_z(k, a, b);
            if (c != 0.0) {
                v += c * input_at(compiled, q, z0 + b, x, H, Sg, last, u);
            }
        }
        new_(a) = v;
    }
    for (i64 a = 0; a < n_he; ++a) {
        H(h0 + a) = new_(a);
    }
    modes(e) = model.guard_target(k);
}

/// Put the input of a sticking element exactly on its level, which the event located to rounding.
inline void settle_on_level(const Model& model, const Combinations& compiled, i64 q, i64 e, Indices modes, Vector x,
    Vector H) {
    i64 z0{}, w0{}, alone{}, count{};
    double rest{}, scale{}, left{}, c{};
    i64 m = model.mode_first(e) + modes(e);
    if (model.mode_stick(m)) {
        z0 = model.first(e, 0);
        w0 = model.first(e, 1);
        rest = -model.mode_level(m);
        alone = -1;
        count = 0;
        scale = 0.0;
        for (i64 j = 0; j < H.size(); ++j) {
            rest += compiled.ZH(q, z0, j) * H(j);
        }
        left = rest;
        for (i64 i = 0, i_end = model.C.shape(1); i < i_end; ++i) {
            c = compiled.Zx(q, z0, i);
            if (c != 0.0) {
                left += c * x(i);
                scale += c * model.B(i, w0);
                alone = i;
                count = count + 1;
            }
        }
        // A state that is the input alone is put there exactly; of several each moves as the output of the element moves
        // it.
        if (count == 1) {
            x(alone) = -rest / compiled.Zx(q, z0, alone);
        } else {
            for (i64 i = 0, i_end = model.C.shape(1); i < i_end; ++i) {
                x(i) -= model.B(i, w0) * left / scale;
            }
        }
    }
}

/// Let the element of a guard that fired, or stays on zero, take its next mode; returns the new mode combination, -1
/// when none has a solution.
inline i64 switch_(const Model& model, const Combinations& compiled, const Work& work, i64 q, i64 which, bool stays,
    Vector x, Vector recent, Vector H, Matrix Sg, i64 last, double u, Indices modes, Vector memory, double base_step) {
    i64 w0{};
    i64 k = compiled.guard(q, which);
    // What has jumped over a sticking level crosses it, and resets and impulses are of the inputs before the event: all
    // is worked out before anything changes (docs/theory/engine.md, Rules at a switch).
    bool aside = stays || beyond_level(model, compiled, q, k, x, recent, H, Sg, last, u);
    double strength = impulse(model, compiled, q, k, x, H, Sg, last, u);
    reset(model, compiled, q, k, x, H, Sg, last, u, modes, memory);
    i64 new_ = compiled.next(q, which);
    if (aside) {
        modes(model.guard_element(k)) = stays ? model.guard_on_threshold(k) : model.guard_bypass(k);
        new_ = -1;
    }
    // A place on the way that is remembered may have been given up to another combination.
    if (new_ < 0 || !is_of(compiled, new_, modes)) {
        new_ = find_combination(model, compiled, work, modes, base_step);
        // Sliding along two surfaces at once has no unique solution here, so the element that arrives crosses its
        // own.
        if (new_ < 0 && model.guard_bypass(k) >= 0 && !aside) {
            aside = true;
            modes(model.guard_element(k)) = model.guard_bypass(k);
            new_ = find_combination(model, compiled, work, modes, base_step);
        }
        if (new_ < 0) {
            return -1;
        }
        if (!aside) {
            compiled.next(q, which) = new_;
        }
    }
    if (strength != 0.0) {
        w0 = model.first(model.guard_element(k), 1);
        for (i64 i = 0, i_end = model.B.shape(0); i < i_end; ++i) {
            x(i) += model.B(i, w0) * strength;
        }
    }
    settle_on_level(model, compiled, new_, model.guard_element(k), modes, x, H);
    return new_;
}

/// State just after an event and its rate just before, into place r of the event buffer.
inline void record(const EventBuffer& buffer, i64 r, Vector x, Vector rate, Vector H, Indices modes) {
    for (i64 i = 0, i_end = buffer.x.shape(1); i < i_end; ++i) {
        buffer.x(r, i) = x(i);
        buffer.v(r, i) = rate(i);
    }
    for (i64 i = 0; i < H.size(); ++i) {
        buffer.H(r, i) = H(i);
    }
    for (i64 i = 0; i < modes.size(); ++i) {
        buffer.modes(r, i) = modes(i);
    }
}

/// First u in [0, 1] where the guard series p rises through zero, by the rules at the start; 2.0 when nowhere, and
/// STAYS where it is zero all along.
inline double rise_from_start(const Combinations& compiled, i64 q, i64 g, Matrix X, i64 last, Matrix Sg, Vector H,
    double d, Vector recent, double clock, Matrix Y, Vector wide, Vector p, bool forced) {
    double noise{};
    i64 terms = least_of<i64>(6, last - 1);
    // A guard at zero goes where its first derivative above rounding points. Where it falls, the zero is
    // divided out, so that the next rise is found however soon it comes (docs/theory/engine.md, Rules at a switch).
    for (i64 k = 0, k_end = greatest_of<i64>(1, terms); k < k_end; ++k) {
        // Two terms decide nearly always; more are wanted only where the guard touches.
        if (k == 2) {
            term_sizes(compiled, q, X, Sg, H, d, recent, clock, 3, terms + 1, Y, wide);
        }
        noise = guard_noise(compiled, q, g, k, Sg, H, d, Y);
        if (p(k) < (-noise)) {
            if (k > 0) {
                for (i64 i = 0, i_end = last + 1; i < i_end; ++i) {
                    p(i) = p(i + k);
                }
            }
            return first_rise(p, (k == 0) ? noise : 0.0);
        }
        // Of two guards that point at each other neither fires: the short step is made in the present mode.
        if (forced) {
            return 2.0;
        }
        if (p(k) > noise) {
            return 0.0;
        }
    }
    return STAYS;
}

}  // namespace EPP_ARCH
}  // namespace epp
