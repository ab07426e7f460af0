#include "answers.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace answers {

/// Mean over a period of exp(-j q phi) on a piece, q = 0..2 n, into `wave`.
void means(const Pieces& pieces, i64 p, i64 n, ComplexVector wave) {
    double real{}, imaginary{}, size{};
    double low = pieces.edges(p);
    double high = pieces.edges(p + 1);
    wave(0) = (high - low) / TURN;
    for (i64 q = 1, q_end = 2 * n + 1; q < q_end; ++q) {
        real = std::cos(low * q) - std::cos(high * q);
        imaginary = std::sin(high * q) - std::sin(low * q);
        size = TURN * q;
        wave(q) = Complex(imaginary / size, -real / size);
    }
}

/// What an output has on a piece besides its input.
double level(const Table& table, const Pieces& pieces, i64 p, i64 o) {
    i64 mode = pieces.modes(p);
    double level = table.w_constant(mode, o);
    for (i64 h = 0, h_end = pieces.memory.shape(1); h < h_end; ++h) {
        level += table.w_memory(mode, o, h) * pieces.memory(p, h);
    }
    return level;
}

/// What real and imaginary part m of a series are to coefficient k of its product with a real function S.
std::tuple<Complex, Complex> product(ComplexVector S, i64 n, i64 k, i64 m) {
    // A real series has a wave at m and one at -m: what S has at k - m and at k + m brings them to k. The mean is no
    // pair.
    i64 q = k - m;
    Complex minus = (q >= 0) ? S(q) : S(-q).conjugate();
    Complex plus = S(k + m);
    double share = k ? 1.0 : 0.5;
    Complex turned = share * (minus - plus);
    return {share * (minus + plus), Complex(-turned.imag, turned.real)};
}

/// Coefficient k of the product of S and a series, of which the mean is real; or of its derivative (factor j m).
Complex convolved(ComplexVector S, i64 n, i64 k, ComplexVector z, bool factor) {
    Complex by_real{}, by_imaginary{};
    double real{}, imaginary{};
    Complex total = Complex(0.0, 0.0);
    for (i64 m = 0, m_end = n + 1; m < m_end; ++m) {
        std::tie(by_real, by_imaginary) = product(S, n, k, m);
        real = z(m).real;
        imaginary = z(m).imag;
        if (factor) {
            real = -m * z(m).imag;
            imaginary = m * z(m).real;
        }
        total += by_real * real;
        if (m) {
            total += by_imaginary * imaginary;
        }
    }
    return total;
}

/// Add the coefficients of the outputs W, and of the functions S and R that input and rate are multiplied with.
void coefficients(const Table& table, const Pieces& pieces, ComplexVector z, double omega, ComplexMatrix W,
    ComplexMatrix S, ComplexMatrix R) {
    Scope scope;
    i64 mode{};
    double free{}, rate{}, level{};
    i64 n = z.size() - 1;
    i64 n_w = W.shape(0);
    ComplexVector wave = empty<Complex>(2 * z.size() - 1);
    for (i64 p = 0, p_end = pieces.modes.size(); p < p_end; ++p) {
        mode = pieces.modes(p);
        means(pieces, p, n, wave);
        for (i64 o = 0; o < n_w; ++o) {
            free = table.w_free(mode, o);
            rate = table.w_rate(mode, o);
            for (i64 q = 0, q_end = 2 * n + 1; q < q_end; ++q) {
                S(o, q) += free * wave(q);
                R(o, q) += rate * wave(q);
            }
            level = answers::level(table, pieces, p, o);
            W(o, 0) += level * wave(0);
            for (i64 k = 1, k_end = n + 1; k < k_end; ++k) {
                W(o, k) += 2.0 * level * wave(k);
            }
        }
    }
    for (i64 o = 0; o < n_w; ++o) {
        for (i64 k = 0, k_end = n + 1; k < k_end; ++k) {
            W(o, k) += convolved(S.row(o), n, k, z, false) + omega * convolved(R.row(o), n, k, z, true);
        }
    }
}

/// What an element that is affine between its switches makes of an input; arguments are those of `settle`.
///
/// Returns
/// -------
/// regime : tuple
///     As `settle`.
/// pieces : Pieces
///     Of the period, where there is one.
/// sums : complex arrays W, S, R, shapes (w, n + 1), (w, 2 n + 1), (w, 2 n + 1)
///     Coefficients of the outputs, and of the functions that their input and its rate are multiplied with.
std::tuple<std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix>, Pieces, std::tuple<ComplexMatrix,
    ComplexMatrix, ComplexMatrix>> answer(const Table& table, ComplexVector z, double omega, i64 mode, bool clocked,
    Vector rest) {
    i64 count{}, there{};
    double start{};
    Vector begun{}, at{};
    Indices fired{};
    Matrix holds{};
    std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix> regime = periodic::settle_part(table, z, omega, mode,
        clocked, rest);
    std::tie(count, there, start, begun, at, fired, holds) = regime;
    i64 s = at.size();
    i64 n_w = table.w_constant.shape(1);
    Vector edges = empty<double>(s + 2);
    Indices modes = empty<i64>(s + 1);
    Matrix memory = empty<double>(s + 1, begun.size());
    edges(0) = start;
    edges(s + 1) = start + TURN;
    modes(0) = there;
    memory.row(0).copy(begun);
    for (i64 i = 0; i < s; ++i) {
        edges(i + 1) = at(i);
        modes(i + 1) = table.target(fired(i));
        memory.row(i + 1).copy(holds.row(i));
    }
    Pieces pieces = Pieces{edges, modes, memory, fired};
    ComplexMatrix W = zeros<Complex>(n_w, z.size());
    ComplexMatrix S = zeros<Complex>(n_w, 2 * z.size() - 1);
    ComplexMatrix R = zeros<Complex>(n_w, 2 * z.size() - 1);
    if (count >= 0) {
        coefficients(table, pieces, z, omega, W, S, R);
    }
    return {regime, pieces, std::tuple<ComplexMatrix, ComplexMatrix, ComplexMatrix>{W, S, R}};
}

/// Add the jumps of the outputs at the switches to those of smooth functions; returns whether there are any.
bool jumps(const Table& table, const Pieces& pieces, ComplexVector z, double omega, Matrix jump) {
    i64 before{}, after{};
    double value{}, slope{}, old{}, new_{};
    i64 n_w = jump.shape(1);
    double largest = 0.0;
    double level = 0.0;
    for (i64 p = 0, p_end = pieces.modes.size(); p < p_end; ++p) {
        for (i64 o = 0; o < n_w; ++o) {
            level = greatest_of(level, std::fabs(answers::level(table, pieces, p, o)));
        }
    }
    for (i64 i = 0, i_end = pieces.fired.size(); i < i_end; ++i) {
        std::tie(value, slope) = periodic::series_at(z, pieces.edges(i + 1));
        before = pieces.modes(i);
        after = pieces.modes(i + 1);
        for (i64 o = 0; o < n_w; ++o) {
            old = table.w_free(before, o) * value + table.w_rate(before, o) * (omega * slope);
            new_ = table.w_free(after, o) * value + table.w_rate(after, o) * (omega * slope);
            old = old + answers::level(table, pieces, i, o);
            new_ = new_ + answers::level(table, pieces, i + 1, o);
            jump(i, o) += new_ - old;
            largest = greatest_of(largest, std::fabs(jump(i, o)));
        }
    }
    return largest > (NO_JUMP * (level + largest));
}

/// Value at a phase of a series without its mean, differentiated `power` times (1 or 2).
double value(ComplexVector c, double phi, i64 power) {
    double angle{}, cosine{}, sine{};
    double total = 0.0;
    for (i64 k = 1; k < c.size(); ++k) {
        angle = k * phi;
        cosine = std::cos(angle);
        sine = std::sin(angle);
        if (power == 1) {
            total -= k * (c(k).real * sine + c(k).imag * cosine);
        } else {
            total -= k * k * (c(k).real * cosine - c(k).imag * sine);
        }
    }
    return total;
}

/// Derivatives of an affine function of the inputs at a phase, by the unknowns into `by_x`, and by the phase.
double read(double free, double rate, double clock, ComplexVector z, double omega, double phi, Vector by_x) {
    double cosine{}, sine{};
    i64 n = z.size() - 1;
    double slope = value(z, phi, 1);
    double curve = value(z, phi, 2);
    for (i64 k = 0, k_end = n + 1; k < k_end; ++k) {
        cosine = std::cos(k * phi);
        sine = std::sin(k * phi);
        by_x(k) = free * cosine - omega * rate * k * sine;
        if (k) {
            by_x(n + k) = -free * sine - omega * rate * k * cosine;
        }
    }
    by_x(2 * n + 1) = rate * slope - clock * phi / (omega * omega);
    return free * slope + omega * rate * curve + clock / omega;
}

/// As `_read`, of what a mode guard writes into a memory value.
double reset(const Table& table, i64 g, i64 h, ComplexVector z, double omega, double phi, Vector by_x) {
    double part{};
    double free = 0.0;
    double rate = 0.0;
    double clock = 0.0;
    for (i64 i = 0, i_end = table.roles.size(); i < i_end; ++i) {
        part = table.from_input(g, h, i);
        if (table.roles(i) == 0) {
            free += part;
        } else if (table.roles(i) == 1) {
            rate += part;
        } else {
            clock += part;
        }
    }
    return read(free, rate, clock, z, omega, phi, by_x);
}

/// Derivatives of the memory values behind a switch, `memory` (h, x), from those before it, `here`.
void pass_on(const Table& table, const Pieces& pieces, ComplexVector z, double omega, i64 i, Matrix here, Matrix moved,
    Matrix memory, Vector by_x) {
    double by_phase{}, new_{};
    i64 g = pieces.fired(i);
    for (i64 h = 0; h < here.shape(0); ++h) {
        by_phase = reset(table, g, h, z, omega, pieces.edges(i + 1), by_x);
        for (i64 x = 0; x < by_x.size(); ++x) {
            new_ = by_x(x) + by_phase * moved(i, x);
            for (i64 other = 0; other < here.shape(0); ++other) {
                new_ += table.from_memory(g, h, other) * here(other, x);
            }
            memory(h, x) = new_;
        }
    }
}

/// Derivatives of the switching phases, (s, x), and of the memory values on each piece, (s + 1, h, x).
///
/// `here` (h, x) holds the latter at the beginning, and afterwards at the end.
void move(const Table& table, const Pieces& pieces, ComplexVector z, double omega, Matrix here, Matrix moved,
    Matrices memory, Vector by_x) {
    i64 g{};
    double phi{}, speed{};
    bool clocked = false;
    for (i64 g_at = 0, g_at_end = table.on_clock.size(); g_at < g_at_end; ++g_at) {
        g = g_at;
        clocked = clocked || table.on_clock(g) != 0.0;
    }
    for (i64 h = 0; h < here.shape(0); ++h) {
        for (i64 x = 0; x < moved.shape(1); ++x) {
            memory(0, h, x) = here(h, x);
        }
    }
    for (i64 i = 0, i_end = pieces.fired.size(); i < i_end; ++i) {
        g = pieces.fired(i);
        phi = pieces.edges(i + 1);
        // Of switches at one phase the later ones move with the first: they do not wait for a zero of their own guard.
        if (i && phi == pieces.edges(i)) {
            for (i64 x = 0; x < moved.shape(1); ++x) {
                moved(i, x) = moved(i - 1, x);
            }
        } else {
            speed = read(table.on_free(g), table.on_rate(g), table.on_clock(g), z, omega, phi, moved.row(i));
            // The guard stays zero where its switch moves: by the implicit function theorem the phase moves by minus the
            // guard's derivative over its rate (docs/theory/harmonic_balance.md, Coefficients without sampling).
            speed = (std::fabs(speed) > GRAZES) ? speed : GRAZES;
            for (i64 x = 0; x < moved.shape(1); ++x) {
                for (i64 h = 0; h < here.shape(0); ++h) {
                    moved(i, x) += table.on_memory(g, h) * memory(i, h, x);
                }
                moved(i, x) = -moved(i, x) / speed;
            }
        }
        pass_on(table, pieces, z, omega, i, memory.row(i), moved, memory.row(i + 1), by_x);
    }
    for (i64 h = 0; h < here.shape(0); ++h) {
        for (i64 x = 0; x < moved.shape(1); ++x) {
            here(h, x) = memory(pieces.fired.size(), h, x);
        }
        // Times count from the begin of a period: in the next one a time that is kept has become less by 2 pi/omega.
        if (clocked) {
            here(h, moved.shape(1) - 1) += TURN / (omega * omega);
        }
    }
}

/// What moving switches contribute: one that comes later keeps the old output for so long.
void add_moved(const Pieces& pieces, Matrix jump, Matrix moved, ComplexMatrices dW) {
    double angle{}, share{}, cosine{}, sine{}, real{}, imaginary{};
    for (i64 i = 0, i_end = pieces.fired.size(); i < i_end; ++i) {
        for (i64 k = 0; k < dW.shape(1); ++k) {
            angle = k * pieces.edges(i + 1);
            share = (k ? 1.0 : 0.5) / PI;
            cosine = share * std::cos(angle);
            sine = share * std::sin(angle);
            for (i64 o = 0; o < dW.shape(0); ++o) {
                real = -jump(i, o) * cosine;
                imaginary = jump(i, o) * sine;
                for (i64 x = 0; x < dW.shape(2); ++x) {
                    dW(o, k, x) += Complex(real * moved(i, x), imaginary * moved(i, x));
                }
            }
        }
    }
}

/// What memory values contribute where they act.
void add_memory(const Table& table, const Pieces& pieces, Matrices memory, ComplexVector wave, ComplexMatrices dW) {
    double on{};
    Complex share{};
    i64 n = dW.shape(1) - 1;
    for (i64 p = 0, p_end = pieces.modes.size(); p < p_end; ++p) {
        means(pieces, p, n, wave);
        for (i64 o = 0; o < dW.shape(0); ++o) {
            for (i64 h = 0; h < memory.shape(1); ++h) {
                on = table.w_memory(pieces.modes(p), o, h);
                if (on != 0.0) {
                    for (i64 k = 0, k_end = n + 1; k < k_end; ++k) {
                        share = on * wave(k) * (k ? 2.0 : 1.0);
                        for (i64 x = 0; x < dW.shape(2); ++x) {
                            dW(o, k, x) += share * memory(p, h, x);
                        }
                    }
                }
            }
        }
    }
}

/// Derivatives (w, n + 1, 2 n + 2) of the coefficients of the outputs by the unknowns.
///
/// Parameters
/// ----------
/// table, pieces, z, omega
///     Of an `answer`.
/// S, R : complex array, shape (w, 2 n + 1)
///     Functions that small changes of the input and of its rate are multiplied with.
/// jump : array, shape (s, w)
///     Of smooth functions at the switches; those of the outputs are added.
/// at_rest : array, shape (h,)
///     Derivatives of the memory values by the mean of the input, where nothing switches.
ComplexMatrices slopes(const Table& table, const Pieces& pieces, ComplexVector z, double omega, ComplexMatrix S,
    ComplexMatrix R, Matrix jump, Vector at_rest) {
    Complex by_real{}, by_imaginary{}, rate_real{}, rate_imaginary{};
    i64 n = z.size() - 1;
    i64 n_w = S.shape(0);
    i64 n_x = 2 * z.size();
    i64 n_switches = pieces.fired.size();
    i64 n_memory = at_rest.size();
    ComplexMatrices dW = empty<Complex>(n_w, n + 1, n_x);
    Matrix moved = zeros<double>(n_switches, n_x);
    ComplexVector wave = empty<Complex>(n_x - 1);
    Matrices memory = zeros<double>(n_switches + 1, n_memory, n_x);
    Matrix work = zeros<double>(n_memory + 1, n_x);
    memory.cut(0, ALL, 0).copy(at_rest);
    for (i64 o = 0; o < n_w; ++o) {
        for (i64 k = 0, k_end = n + 1; k < k_end; ++k) {
            for (i64 m = 0, m_end = n + 1; m < m_end; ++m) {
                std::tie(by_real, by_imaginary) = product(S.row(o), n, k, m);
                // A real part adds j m omega, an imaginary part -m omega to the rate's coefficient.
                std::tie(rate_real, rate_imaginary) = product(R.row(o), n, k, m);
                dW(o, k, m) = by_real + omega * m * rate_imaginary;
                if (m) {
                    dW(o, k, n + m) = by_imaginary - omega * m * rate_real;
                }
            }
            dW(o, k, n_x - 1) = convolved(R.row(o), n, k, z, true);
        }
    }
    // Where the output is continuous a moving switch changes nothing to first order.
    // Twice round: what memory holds at the begin was written in the period before, whose derivatives the first turn
    // finds.
    if (n_switches && (jumps(table, pieces, z, omega, jump) || n_memory)) {
        for (i64 turn_ = 0, turn__end = n_memory ? 2 : 1; turn_ < turn__end; ++turn_) {
            move(table, pieces, z, omega, work.slice(1, work.shape(0)), moved, memory, work.row(0));
        }
        add_moved(pieces, jump, moved, dW);
    }
    if (n_memory) {
        add_memory(table, pieces, memory, wave, dW);
    }
    return dW;
}

/// Derivatives of the equations of a balance by its unknowns, both of number F (2 n + 1) + 1.
///
/// Parameters
/// ----------
/// dW, W : complex array, shapes (w, n + 1, F (2 n + 1) + 1), (w, n + 1)
///     Coefficients of the outputs and their derivatives.
/// L, dL : complex array, shape (n, F, w)
///     Responses from outputs to inputs at the harmonics, and their derivatives by the frequency.
/// on_bias, on_mean : array, shapes (F, F), (F, w)
///     Static balance.
/// pivot : int
///     The input that is in sine phase.
Matrix jacobian(ComplexMatrices dW, ComplexMatrix W, ComplexMatrices L, ComplexMatrices dL, Matrix on_bias,
    Matrix on_mean, i64 pivot) {
    i64 real{}, imaginary{};
    double share{};
    Complex response{}, value{};
    i64 n = L.shape(0);
    i64 F = L.shape(1);
    i64 n_w = L.shape(2);
    i64 width = 2 * n + 1;
    i64 last = dW.shape(2) - 1;
    Matrix J = zeros<double>(last + 1, last + 1);
    for (i64 f = 0; f < F; ++f) {
        for (i64 j = 0; j < n_w; ++j) {
            share = on_mean(f, j);
            if (share != 0.0) {
                for (i64 x = 0, x_end = last + 1; x < x_end; ++x) {
                    J(f, x) += share * dW(j, 0, x).real;
                }
            }
        }
        for (i64 g = 0; g < F; ++g) {
            J(f, g * width) += on_bias(f, g);
        }
        for (i64 k = 0; k < n; ++k) {
            real = F + f * n + k;
            imaginary = F + (F + f) * n + k;
            for (i64 j = 0; j < n_w; ++j) {
                response = L(k, f, j);
                if (response != 0.0) {
                    for (i64 x = 0, x_end = last + 1; x < x_end; ++x) {
                        value = response * dW(j, k + 1, x);
                        J(real, x) -= value.real;
                        J(imaginary, x) -= value.imag;
                    }
                }
                value = dL(k, f, j) * W(j, k + 1);
                J(real, last) -= value.real;
                J(imaginary, last) -= value.imag;
            }
            J(real, f * width + 1 + k) += 1.0;
            J(imaginary, f * width + n + 1 + k) += 1.0;
        }
    }
    J(last, pivot * width + 1) = 1.0;
    return J;
}

/// The equations of a balance at its unknowns X, mean, real and imaginary parts of each input, and omega at last.
///
/// Where there is no room for a Jacobian, what the elements put out alone.
///
/// Parameters
/// ----------
/// automata : Automata
/// rest : array
///     Memory values of all elements at rest.
/// linear : tuple of complex arrays L, dL, shape (n, F, w)
///     As of `jacobian`.
/// means : tuple of arrays on_bias, on_mean, prescribed, shapes (F, F), (F, w), (F,)
///     Static balance.
/// J, R, W, switches : arrays, shapes (x, x), (x,), (w, n + 1), (F,)
///     Are filled with the Jacobian, the residual, the coefficients of the outputs, and the number of switches of each
///     element in a period.
///
/// Returns
/// -------
/// bool
///     Whether each element answers periodically, and none whose slope is wanted rests with a value that it holds.
bool equations(const Automata& automata, Vector rest, Vector X, const std::tuple<ComplexMatrices,
    ComplexMatrices>& linear, const std::tuple<Matrix, Matrix, Vector>& means, i64 pivot, Matrix J, Vector R,
    ComplexMatrix W, Indices switches) {
    Scope scope;
    ComplexMatrices L{}, dL{}, slope{};
    Matrix on_bias{}, on_mean{}, jump{};
    Vector prescribed{}, begun{}, at_rest{};
    i64 at{}, out{}, end{};
    double static_{};
    Table table{};
    std::tuple<i64, i64, double, Vector, Vector, Indices, Matrix> regime{};
    Pieces pieces{};
    std::tuple<ComplexMatrix, ComplexMatrix, ComplexMatrix> sums{};
    Complex away{};
    std::tie(L, dL) = linear;
    std::tie(on_bias, on_mean, prescribed) = means;
    i64 n = L.shape(0);
    i64 F = L.shape(1);
    i64 width = 2 * n + 1;
    i64 last = X.size() - 1;
    double omega = X(X.shape(0) - 1);
    ComplexMatrix Z = empty<Complex>(F, n + 1);
    ComplexMatrices dW = zeros<Complex>(W.shape(0), n + 1, X.size());
    for (i64 f = 0; f < F; ++f) {
        at = f * width;
        out = automata.first(f, 0);
        end = automata.first(f + 1, 0);
        Z(f, 0) = X(at);
        for (i64 k = 1, k_end = n + 1; k < k_end; ++k) {
            Z(f, k) = Complex(X(at + k), X(at + n + k));
        }
        table = automata.tables(f);
        begun = rest.slice(automata.first(f, 1), automata.first(f + 1, 1));
        std::tie(regime, pieces, sums) = answer(table, Z.row(f), omega, automata.modes(f), automata.clocked(f), begun);
        W.slice(out, end).copy(std::get<0>(sums));
        switches(f) = pieces.fired.size();
        if (std::get<0>(regime) < 0 || (J.size() > 0 && begun.size() > 0 && switches(f) == 0)) {
            return false;
        }
        if (J.size() == 0) {
            continue;
        }
        jump = zeros<double>(switches(f), end - out);
        at_rest = zeros<double>(begun.size());
        slope = slopes(table, pieces, Z.row(f), omega, std::get<1>(sums), std::get<2>(sums), jump, at_rest);
        dW.cut(Span{out, end}, ALL, Span{at, at + width}).copy(slope.cut(ALL, ALL, Span{0, slope.shape(2) - 1}));
        dW.cut(Span{out, end}, ALL, last).copy(slope.cut(ALL, ALL, slope.shape(2) - 1));
    }
    if (J.size() == 0) {
        return true;
    }
    J.copy(jacobian(dW, W, L, dL, on_bias, on_mean, pivot));
    for (i64 f = 0; f < F; ++f) {
        static_ = -prescribed(f);
        for (i64 g = 0; g < F; ++g) {
            static_ += on_bias(f, g) * Z(g, 0).real;
        }
        for (i64 j = 0; j < W.shape(0); ++j) {
            static_ += on_mean(f, j) * W(j, 0).real;
        }
        R(f) = static_;
        for (i64 k = 0; k < n; ++k) {
            away = Z(f, k + 1);
            for (i64 j = 0; j < W.shape(0); ++j) {
                away -= L(k, f, j) * W(j, k + 1);
            }
            R(F + f * n + k) = away.real;
            R(F + (F + f) * n + k) = away.imag;
        }
    }
    R(last) = Z(pivot, 1).real;
    return true;
}

}  // namespace answers
}  // namespace EPP_ARCH
}  // namespace epp
