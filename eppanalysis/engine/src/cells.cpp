#include "cells.hpp"
#include "fields.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace cells {

double refined(Matrix signals, i64 n, i64 i, i64 j) {
    double a = signals(modulo(i - 1, n), j);
    double b = signals(i, j);
    double c = signals(modulo(i + 1, n), j);
    // The vertex of the parabola through three samples; flat ones have none.
    double bend = a - 2.0 * b + c;
    if (bend == 0.0) {
        return b;
    }
    double shift = 0.5 * (a - c) / bend;
    return (std::fabs(shift) < 1.0) ? b - 0.25 * (a - c) * shift : b;
}

/// Mean, extrema and rms of one period, sampled evenly; each extremum by a parabola through three samples.
void shape(Matrix signals, i64 n, Vector mean, Vector low, Vector high, Vector rms) {
    double total{};
    i64 top{}, bottom{};
    for (i64 j = 0; j < mean.size(); ++j) {
        total = 0.0;
        top = 0;
        bottom = 0;
        for (i64 i = 0, i_end = n - 1; i < i_end; ++i) {
            total += 0.5 * (signals(i, j) + signals(i + 1, j));
            if (signals(i, j) > signals(top, j)) {
                top = i;
            }
            if (signals(i, j) < signals(bottom, j)) {
                bottom = i;
            }
        }
        mean(j) = total / (n - 1);
        total = 0.0;
        for (i64 i = 0, i_end = n - 1; i < i_end; ++i) {
            total += 0.5 * (whole_power(signals(i, j) - mean(j), 2) + whole_power(signals(i + 1, j) - mean(j), 2));
        }
        rms(j) = std::sqrt(total / (n - 1));
        high(j) = refined(signals, n - 1, top, j);
        low(j) = refined(signals, n - 1, bottom, j);
    }
}

/// Run cells first..last-1 of a stack of models; every result goes to its own place in `out`.
///
/// A stack of one model serves all cells, and its mode combinations are compiled once.
/// `none` and `period_samples` are Samples without and with SAMPLES + 1 times; mode combinations, work and workspace
/// are those of any of the models, from these cells alone; `now` says when runs end.
void run_cells(const Models& stack, const Combinations& compiled, const Work& work, const Workspace& workspace,
    const Samples& none, const Samples& period_samples, const EventBuffer& buffer, Progress& now, Matrix x0,
    IndexMatrix modes0, Matrix H0, Flags compared, Vector base_step, i64 first, i64 last, const Outcome& out) {
    Scope scope;
    i64 code{}, count{}, kind{}, p{}, k{};
    double period{};
    Model model{};
    i64 n = x0.shape(1);
    i64 keep = buffer.t.size();
    Vector x = workspace.x;
    Indices modes = workspace.modes;
    Vector H = workspace.H;
    Vector found = empty<double>(4);
    double t_end = now.t_end;
    Vector times = period_samples.times;
    Matrix signals = period_samples.out;
    bool one = stack.A.shape(0) == 1;
    for (i64 c = first; c < last; ++c) {
        model = one_of(stack, one ? 0 : c);
        filling::fill(x.slice(0, n), x0.row(c));
        filling::fill(modes, modes0.row(c));
        filling::fill(H, H0.row(c));
        if (!one || base_step(c) != now.base_step) {
            compiled.count(0) = 0;
        }
        now.base_step = base_step(c);
        now.t_end = t_end;
        now.watch = true;
        now.paused = false;
        code = PAUSED;
        while (code == PAUSED) {
            if (out.stop(0)) {
                return;
            }
            code = epp::run(model, compiled, work, workspace, none, buffer, now);
        }
        count = now.count;
        out.code(c) = code;
        out.events(c) = count;
        out.since(c) = (count > 0) ? buffer.t(modulo(count - 1, keep)) : 0.0;
        if (code != 0) {
            continue;
        }
        kind = verdict::verdict_of_run(model, buffer.t, buffer.guard, buffer.x, buffer.v, count, t_end, workspace.low,
            workspace.high, x, workspace.rate, compared, found);
        out.verdict(c) = kind;
        // The run to the verdict takes no samples: the last period is run once more, from where it began, for its
        // shape.
        if (kind == CYCLE) {
            p = i64(found(0));
            period = found(1);
            out.period(c) = period;
            out.change(c, 0) = found(2);
            out.change(c, 1) = found(3);
            k = modulo(count - 1 - p, keep);
            filling::fill(x.slice(0, n), buffer.x.row(k));
            filling::fill(modes, buffer.modes.row(k));
            filling::fill(H, buffer.H.row(k));
            for (i64 i = 0, i_end = SAMPLES + 1; i < i_end; ++i) {
                times(i) = period * i / SAMPLES;
            }
        } else if (kind == SETTLED) {
            // A run of no length to speak of gives the signals at its state.
            period = 1e-12 * t_end;
            for (i64 i = 0, i_end = SAMPLES + 1; i < i_end; ++i) {
                times(i) = 2.0 * i * period;
            }
        } else {
            continue;
        }
        now.t_end = period;
        now.watch = false;
        code = PAUSED;
        while (code == PAUSED && !out.stop(0)) {
            code = epp::run(model, compiled, work, workspace, period_samples, buffer, now);
        }
        if (kind == SETTLED) {
            for (Matrix whole : {out.mean, out.low, out.high}) {
                filling::fill(whole.row(c), signals.row(0));
            }
            out.rms.row(c).fill(0.0);
        } else {
            shape(signals, now.i_sample, out.mean.row(c), out.low.row(c), out.high.row(c), out.rms.row(c));
        }
    }
    now.t_end = t_end;
}

}  // namespace cells
}  // namespace EPP_ARCH
}  // namespace epp
