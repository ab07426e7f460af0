#include "describing/sinusoid.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace describing_sinusoid {

/// The first input, its rate as the second one, and the rates of both; further ones stay at zero.
void inputs(double a, double b, double omega, double phi, Vector z, Vector rate) {
    double sine = std::sin(phi);
    double cosine = std::cos(phi);
    z(0) = b + a * sine;
    rate(0) = a * omega * cosine;
    if (z.size() > 1) {
        z(1) = rate(0);
        rate(1) = -a * omega * omega * sine;
    }
}

void outputs(const Rules& rules, i64 mode, Vector z, Vector memory, Vector w) {
    double v{}, c{}, u{}, f{};
    i64 kind{};
    for (i64 i = 0; i < w.size(); ++i) {
        v = rules.constant(mode, i);
        for (i64 j = 0; j < z.size(); ++j) {
            v += rules.from_input(mode, i, j) * z(j);
        }
        for (i64 j = 0; j < memory.size(); ++j) {
            v += rules.from_memory(mode, i, j) * memory(j);
        }
        for (i64 j = 0, j_end = rules.smooth_kind.size(); j < j_end; ++j) {
            c = rules.from_smooth(mode, i, j);
            if (c != 0.0) {
                u = rules.smooth_constant(j);
                for (i64 k = 0; k < z.size(); ++k) {
                    u += rules.smooth_input(j, k) * z(k);
                }
                kind = rules.smooth_kind(j);
                if (kind >= SQUARE) {
                    f = std::get<0>(epp::curve(kind, u));
                } else {
                    f = (kind == 0) ? std::sin(u) : ((kind == 1) ? u * u * u : 1.0 / (1.0 + std::fabs(u)));
                }
                v += c * rules.smooth_scale(j) * f;
            }
        }
        w(i) = v;
    }
}

/// Value of a guard at a phase.
double guard(const Rules& rules, i64 g, i64 mode, double a, double b, double omega, double phi, Vector memory,
    Vector z, Vector rate, Vector w) {
    inputs(a, b, omega, phi, z, rate);
    double v = rules.guard_constant(g);
    for (i64 j = 0; j < z.size(); ++j) {
        v += rules.on_input(g, j) * z(j) + rules.on_rate(g, j) * rate(j);
    }
    for (i64 j = 0; j < memory.size(); ++j) {
        v += rules.on_memory(g, j) * memory(j);
    }
    bool on_output = false;
    for (i64 j = 0; j < w.size(); ++j) {
        on_output = on_output || rules.on_output(g, j) != 0.0;
    }
    if (on_output) {
        outputs(rules, mode, z, memory, w);
        for (i64 j = 0; j < w.size(); ++j) {
            v += rules.on_output(g, j) * w(j);
        }
    }
    return v;
}

/// An output without smooth functions as ``level + sine sin(phi) + cosine cos(phi)``.
Wave output_wave(const Rules& rules, i64 mode, i64 i, double a, double b, double omega, Vector memory) {
    Wave wave{rules.constant(mode, i) + rules.from_input(mode, i, 0) * b, rules.from_input(mode, i, 0) * a, 0.0};
    if (rules.from_input.shape(2) > 1) {
        wave.cosine = rules.from_input(mode, i, 1) * a * omega;
    }
    for (i64 j = 0; j < memory.size(); ++j) {
        wave.level += rules.from_memory(mode, i, j) * memory(j);
    }
    return wave;
}

/// A guard as ``level + sine sin(phi) + cosine cos(phi)``; not a number where a smooth function acts on it.
Wave guard_wave(const Rules& rules, i64 g, i64 mode, double a, double b, double omega, Vector memory) {
    Wave wave{rules.guard_constant(g) + rules.on_input(g, 0) * b, rules.on_input(g, 0) * a,
        rules.on_rate(g, 0) * a * omega};
    if (rules.on_input.shape(1) > 1) {
        wave.cosine += rules.on_input(g, 1) * a * omega;
        wave.sine -= rules.on_rate(g, 1) * a * omega * omega;
    }
    for (i64 j = 0; j < memory.size(); ++j) {
        wave.level += rules.on_memory(g, j) * memory(j);
    }
    for (i64 i = 0; i < rules.constant.shape(1); ++i) {
        double share = rules.on_output(g, i);
        if (share != 0.0) {
            for (i64 j = 0; j < rules.smooth_kind.size(); ++j) {
                if (rules.from_smooth(mode, i, j) != 0.0) {
                    return {NaN, NaN, NaN};
                }
            }
            Wave more = output_wave(rules, mode, i, a, b, omega, memory);
            wave = {wave.level + share * more.level, wave.sine + share * more.sine,
                wave.cosine + share * more.cosine};
        }
    }
    return wave;
}

/// Where a wave rises through zero, which it does between two phases.
double rise(const Wave& wave, double low, double high) {
    double turned = std::atan2(wave.cosine, wave.sine);
    double share = -wave.level / std::hypot(wave.sine, wave.cosine);
    double phi = std::asin(std::min(std::max(share, -1.0), 1.0)) - turned;
    phi += 2.0 * PI * std::floor((0.5 * (low + high) - phi) / (2.0 * PI) + 0.5);
    return std::min(std::max(phi, low), high);
}

/// The guard of a mode that rises first in a step, and the phase behind its rise; -1 for none.
std::tuple<i64, double> next_event(const Rules& rules, i64 mode, double a, double b, double omega, double low,
    double high, Vector memory, Vector z, Vector rate, Vector w) {
    double left{}, right{}, middle{};
    i64 best = -1;
    double where = high;
    // Looked at where the first one so far rises, and not at the end of the step: only an earlier one takes its
    // place.
    for (i64 g = 0, g_end = rules.guard_mode.size(); g < g_end; ++g) {
        if (rules.guard_mode(g) != mode || !(guard(rules, g, mode, a, b, omega, where, memory, z, rate, w) > 0.0)) {
            continue;
        }
        left = low;
        right = where;
        if (guard(rules, g, mode, a, b, omega, low, memory, z, rate, w) > 0.0) {
            right = low;
        }
        Wave wave = guard_wave(rules, g, mode, a, b, omega, memory);
        if (right > left && std::fabs(wave.sine) + std::fabs(wave.cosine) > 0.0) {
            // An arc sine says where a sinusoid is zero, but for its last digits: these are bisected.
            double near = rise(wave, left, right);
            double reach = 4e-16 * (1.0 + std::fabs(right));
            while (near + reach < right) {
                if (guard(rules, g, mode, a, b, omega, near + reach, memory, z, rate, w) > 0.0) {
                    right = near + reach;
                }
                reach *= 4.0;
            }
            reach = 4e-16 * (1.0 + std::fabs(right));
            while (near - reach > left) {
                if (!(guard(rules, g, mode, a, b, omega, near - reach, memory, z, rate, w) > 0.0)) {
                    left = near - reach;
                }
                reach *= 4.0;
            }
        }
        while ((right - left) > (4e-16 * (1.0 + std::fabs(right)))) {
            middle = 0.5 * (left + right);
            if (middle <= left || middle >= right) {
                break;
            }
            if (guard(rules, g, mode, a, b, omega, middle, memory, z, rate, w) > 0.0) {
                right = middle;
            } else {
                left = middle;
            }
        }
        best = g;
        where = right;
    }
    return {best, where};
}

/// Add Gauss's rule for the integrals of output, output times sine and times cosine; returns the largest output.
double panel(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Vector z, Vector rate, Vector w, Matrix total) {
    double phi{}, weight{};
    double largest = 0.0;
    for (i64 k = 0; k < PLACE.size(); ++k) {
        phi = 0.5 * (low + high) + 0.5 * (high - low) * PLACE(k);
        weight = 0.5 * (high - low) * WEIGHT(k);
        inputs(a, b, omega, phi, z, rate);
        outputs(rules, mode, z, memory, w);
        double sine = std::sin(phi);
        double cosine = std::cos(phi);
        for (i64 i = 0; i < w.size(); ++i) {
            total(0, i) += weight * w(i);
            total(1, i) += weight * w(i) * sine;
            total(2, i) += weight * w(i) * cosine;
            largest = greatest_of(largest, std::fabs(w(i)));
        }
    }
    return largest;
}

/// Add the integrals of outputs, these times sine and times cosine, that are affine in a sinusoid.
void add_waves(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Matrix total) {
    double width = high - low;
    double s_low = std::sin(low), c_low = std::cos(low), s_high = std::sin(high), c_high = std::cos(high);
    double of_sine = c_low - c_high;
    double of_cosine = s_high - s_low;
    double both = 0.5 * (s_high * s_high - s_low * s_low);
    double turned = 0.5 * (s_high * c_high - s_low * c_low);
    for (i64 i = 0; i < total.shape(1); ++i) {
        Wave wave = output_wave(rules, mode, i, a, b, omega, memory);
        total(0, i) += wave.level * width + wave.sine * of_sine + wave.cosine * of_cosine;
        total(1, i) += wave.level * of_sine + wave.sine * (0.5 * width - turned) + wave.cosine * both;
        total(2, i) += wave.level * of_cosine + wave.sine * both + wave.cosine * (0.5 * width + turned);
    }
}

/// Add the integrals of output, output times sine and times cosine from phase to phase, shape (3, w).
///
/// Those of an output that is affine in a sinusoid are closed forms. Smooth functions may vary within a small part of a
/// step: their panels are halved until two halves give what the whole gives, and grow again behind. False where that
/// takes too many: they vary too fast, or are so small that their last digits round to nothing.
bool integrate(const Rules& rules, i64 mode, double a, double b, double omega, double low, double high, Vector memory,
    Vector z, Vector rate, Vector w, Matrix total, Matrix once, Matrix twice) {
    double right{}, middle{}, largest{}, worst{};
    if (rules.smooth_kind.size() == 0) {
        add_waves(rules, mode, a, b, omega, low, high, memory, total);
        return true;
    }
    double left = low;
    double width = high - low;
    for (i64 panels = 0; left < high; ++panels) {
        if (panels == MOST_PANELS) {
            return false;
        }
        right = ((left + 1.5 * width) > high) ? high : left + width;
        middle = 0.5 * (left + right);
        once.fill(0.0);
        twice.fill(0.0);
        panel(rules, mode, a, b, omega, left, right, memory, z, rate, w, once);
        largest = panel(rules, mode, a, b, omega, left, middle, memory, z, rate, w, twice);
        largest = greatest_of(largest, panel(rules, mode, a, b, omega, middle, right, memory, z, rate, w, twice));
        worst = 0.0;
        for (i64 i = 0; i < 3; ++i) {
            for (i64 j = 0; j < w.size(); ++j) {
                worst = greatest_of(worst, std::fabs(twice(i, j) - once(i, j)));
            }
        }
        if (worst > (AGREES * largest * (right - left)) && (right - left) > NARROWEST) {
            width = 0.5 * (right - left);
            continue;
        }
        total.add(twice);
        {
            const double was1 = right;
            const double was2 = 2.0 * (right - left);
            left = was1;
            width = was2;
        }
    }
    return true;
}

/// Memory values behind the event of a guard.
void write(const Rules& rules, i64 g, double a, double b, double omega, double phi, Vector z, Vector rate,
    Vector memory, Vector before) {
    double v{};
    inputs(a, b, omega, phi, z, rate);
    filling::fill(before, memory);
    for (i64 h = 0; h < memory.size(); ++h) {
        v = rules.memory_constant(g, h);
        for (i64 j = 0; j < z.size(); ++j) {
            v += rules.memory_from_input(g, h, j) * z(j);
        }
        for (i64 j = 0; j < memory.size(); ++j) {
            v += rules.memory_from_memory(g, h, j) * before(j);
        }
        memory(h) = v;
    }
}

/// Integrals over some steps into `total`, (3, w); the mode at their end, and switches. It is -1 where these, or the
/// panels of an integral, never end.
std::tuple<i64, i64> steps(const Rules& rules, i64 mode, double a, double b, double omega, i64 first, i64 last,
    Vector memory, Vector z, Vector rate, Vector w, Vector before, Matrix total, Matrix once, Matrix twice) {
    double phi{}, stop{}, where{};
    i64 g{};
    i64 switches = 0;
    total.fill(0.0);
    double step = 2.0 * PI / STEPS;
    for (i64 i = first; i < last; ++i) {
        phi = i * step;
        stop = (i + 1) * step;
        for (i64 events = 0, events_end = MOST_EVENTS + 1; events < events_end; ++events) {
            if (events == MOST_EVENTS) {
                return {-1, switches};
            }
            std::tie(g, where) = next_event(rules, mode, a, b, omega, phi, stop, memory, z, rate, w);
            if (!integrate(rules, mode, a, b, omega, phi, where, memory, z, rate, w, total, once, twice)) {
                return {-1, switches};
            }
            if (g < 0) {
                break;
            }
            phi = where;
            write(rules, g, a, b, omega, phi, z, rate, memory, before);
            mode = rules.target(g);
            ++switches;
        }
    }
    return {mode, switches};
}

/// Mean outputs and gains (points, w) for points of amplitude, bias and frequency (points,).
///
/// Not a number where an element switches or varies without end, or does not answer with the period of its input.
void describe(const Rules& rules, i64 start_mode, Vector a, Vector b, Vector omega, Matrix mean, ComplexMatrix gain) {
    Scope scope;
    i64 mode{}, first{}, switches{};
    bool repeats{}, same{};
    double moved{}, size{};
    i64 n_w = rules.constant.shape(1);
    i64 n_z = rules.on_input.shape(1);
    i64 n_h = rules.start.size();
    Vector z = zeros<double>(n_z);
    Vector rate = zeros<double>(n_z);
    Vector w = zeros<double>(n_w);
    Vector memory = zeros<double>(n_h);
    Vector before = zeros<double>(n_h);
    Matrix total = zeros<double>(3, n_w);
    Matrix once = zeros<double>(3, n_w);
    Matrix twice = zeros<double>(3, n_w);
    Vector begin = zeros<double>(n_h);
    for (i64 p = 0; p < a.size(); ++p) {
        mode = start_mode;
        repeats = false;
        filling::fill(memory, rules.start);
        std::tie(mode, switches) =
            steps(rules, mode, a(p), b(p), omega(p), 0, RUN_IN, memory, z, rate, w, before, total, once, twice);
        for (i64 turn_ = 0; turn_ < PERIODS && mode >= 0; ++turn_) {
            first = mode;
            filling::fill(begin, memory);
            std::tie(mode, switches) = steps(rules, mode, a(p), b(p), omega(p), RUN_IN, RUN_IN + STEPS, memory, z, rate,
                w, before, total, once, twice);
            // The integrals are those of the last period: of an answer that has not come back they would be of one turn.
            same = mode >= 0 && mode == first;
            repeats = same;
            for (i64 h = 0; h < n_h; ++h) {
                moved = std::fabs(memory(h) - begin(h));
                size = std::fabs(memory(h)) + a(p);
                // Each switch is where it is to rounding, and so is what it writes.
                same = same && moved <= (1e-14 * size * (1 + switches));
                repeats = repeats && moved <= (REPEATS * (size + std::fabs(b(p))));
            }
            if (same) {
                break;
            }
        }
        for (i64 i = 0; i < n_w; ++i) {
            mean(p, i) = repeats ? total(0, i) / (2.0 * PI) : NaN;
            gain(p, i) = repeats ? Complex(total(1, i), total(2, i)) / (PI * a(p)) : Complex(NaN, 0.0);
        }
    }
}

}  // namespace describing_sinusoid
}  // namespace EPP_ARCH
}  // namespace epp
