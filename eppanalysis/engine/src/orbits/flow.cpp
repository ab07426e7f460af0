#include "orbits/flow.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_flow {

/// Room for the flow of the states that move of themselves or one another; those behind are clocks.
///
/// With dead time an orbit has a clock for each switch on its way: a hundred of them beside two states of a plant.
Matrices room(Matrices F) {
    i64 p = F.shape(0);
    i64 n = F.shape(1);
    i64 moving = 1;
    for (i64 a = 0; a < p; ++a) {
        for (i64 i = 0; i < n; ++i) {
            for (i64 j = 0; j < n; ++j) {
                if (F(a, i, j) != 0.0) {
                    moving = greatest_of<i64>(greatest_of<i64>(moving, i + 1), j + 1);
                }
            }
        }
    }
    return zeros<double>(8, padded(moving), padded(moving));
}

/// The numbers of an arc; where no derivative by a parameter is wanted they are in its place, unread.
None numbers_of(None channels, Matrix F, Matrix S) {
    return {};
}

/// State at the end of an arc with smooth channels, its derivative, and there the channels with their slopes.
///
/// The derivative Phi (N, N) is that by the state at the begin. With one more column (N, N + 1) it holds the change
/// with a parameter of which `by` has the derivatives, too.
///
/// Returns the number of series made. The end is not a number where it is not reached with `most` of them: the stiffer
/// the motion, the shorter its series.
i64 smooth_flow(None channels, i64 arc, Matrix F, Matrix S, Vector y, double tau, i64 most, Vector end, Matrix Phi,
    Vector sigma, Vector slope, None by) {
    return 0;
}

/// State at the end of an affine arc, and its derivative; `square` is what `room` gave.
void affine_flow(Matrix F, Vector y, double tau, Vector end, Matrix Phi, Matrices square) {
    Scope scope;
    double rate{}, v{}, f{};
    i64 n = F.shape(0);
    i64 N = F.shape(1);
    i64 moving = least_of<i64>(n, square.shape(1));
    Matrix M = square.row(0);
    Matrix integral = square.row(1);
    Matrix power = square.row(2);
    for (i64 i = 0; i < moving; ++i) {
        for (i64 j = 0; j < moving; ++j) {
            M(i, j) = F(i, j);
        }
    }
    if (tau == 0.0) {
        integral.fill(0.0);
        filling::fill_rows(power, identity(power.shape(0)));
    } else {
        rate = epp::growth_rate(M, square.row(3), square.row(4));
        epp::flow(M, tau, rate, integral, power, square.row(5), square.row(6), square.row(7));
    }
    Phi.fill(0.0);
    for (i64 i = 0; i < N; ++i) {
        end(i) = y(i);
        Phi(i, i) = 1.0;
    }
    // The integral of exp(F s), times the rate, is added to y: near rest and for integrators nothing cancels.
    for (i64 i = 0; i < moving; ++i) {
        v = 0.0;
        for (i64 j = 0; j < N; ++j) {
            v += F(i, j) * y(j);
        }
        for (i64 k = 0; k < moving; ++k) {
            end(k) += integral(k, i) * v;
        }
        for (i64 j = 0; j < moving; ++j) {
            Phi(i, j) = power(i, j);
        }
        for (i64 k = 0; k < moving; ++k) {
            f = integral(i, k);
            if (f != 0.0) {
                for (i64 j = n; j < N; ++j) {
                    Phi(i, j) += f * F(k, j);
                }
            }
        }
    }
    for (i64 i = moving; i < n; ++i) {
        for (i64 j = n; j < N; ++j) {
            end(i) += tau * F(i, j) * y(j);
            Phi(i, j) = tau * F(i, j);
        }
    }
}

/// Rate of the state on an arc.
void rate_at(Matrix F, Matrix S, Vector y, Vector sigma, Vector rate) {
    double v{};
    for (i64 i = 0; i < F.shape(0); ++i) {
        v = 0.0;
        for (i64 j = 0; j < y.size(); ++j) {
            v += F(i, j) * y(j);
        }
        for (i64 j = 0; j < sigma.size(); ++j) {
            v += S(i, j) * sigma(j);
        }
        rate(i) = v;
    }
}

/// The numbers of an arc; where no derivative by a parameter is wanted they are in its place, unread.
Numbers numbers_of(const Channels& channels, Matrix F, Matrix S) {
    return Numbers{F, S, channels.smooth_x, channels.smooth_H, channels.smooth_s, channels.smooth_scale};
}

/// Coefficient k of smooth channel j and of its derivative with respect to its argument.
void channel_term(const Channels& model, Vector sense, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix arg,
    Matrix aux, Matrix slope) {
    i64 kind = model.smooth_kind(j);
    double scale = model.smooth_scale(j);
    if (kind != RECIPROCAL) {
        epp::smooth_term(model, j, k, X, H, Sg, arg, aux);
        if (kind >= SQUARE) {
            slope(k, j) = epp::curve_slope_term(kind, j, k, scale, Sg, arg, aux);
        } else {
            slope(k, j) = (kind == SINE) ? aux(k, j) : 3.0 * scale * aux(k, j);
        }
        return;
    }
    // scale/(1 + s a), with the sign s of the mode: at breakaway the argument and its rate are both zero.
    arg(k, j) = epp::argument(model, j, k, X, H, Sg);
    double s = sense(j);
    double v = (k == 0) ? scale : 0.0;
    for (i64 i = 1, i_end = k + 1; i < i_end; ++i) {
        v -= s * arg(i, j) * Sg(k - i, j);
    }
    Sg(k, j) = v / (1.0 + s * arg(0, j));
    v = 0.0;
    for (i64 i = 0, i_end = k + 1; i < i_end; ++i) {
        v += Sg(i, j) * Sg(k - i, j);
    }
    slope(k, j) = (scale != 0.0) ? -s * v / scale : 0.0;
}

/// Add to coefficient k of the rate of change with a parameter what it changes itself, channels at their values.
void rate_by(const Numbers& by, i64 k, Matrix X, Vector H, Matrix Sg, Matrices V) {
    double v{};
    i64 n = X.shape(1);
    i64 last = V.shape(2) - 1;
    for (i64 i = 0; i < n; ++i) {
        v = 0.0;
        for (i64 j = 0; j < n; ++j) {
            v += by.F(i, j) * X(k, j);
        }
        if (k == 0) {
            for (i64 j = 0; j < H.size(); ++j) {
                v += by.F(i, n + j) * H(j);
            }
        }
        for (i64 j = 0, j_end = by.S.shape(1); j < j_end; ++j) {
            v += by.S(i, j) * Sg(k, j);
        }
        V(k + 1, i, last) += v;
    }
}

/// Coefficient k of the derivatives of smooth channel j: of its argument, and of its value behind it.
///
/// The chain rule on series: the channel's slope times the derivative of its argument, convolved.
void change_term(const Channels& channels, i64 j, i64 k, Matrices V, Matrix slope, View<double, 4> change, i64 N) {
    i64 n = V.shape(1);
    Matrix of_argument = change.row(0, j);
    Matrix of_value = change.row(1, j);
    of_argument.row(k).fill(0.0);
    of_value.row(k).fill(0.0);
    for (i64 i = 0; i < n; ++i) {
        filling::accumulate(of_argument.row(k), channels.smooth_x(j, i), V.row(k, i));
    }
    if (k == 0) {
        filling::accumulate(of_argument.row(0).slice(n, N), 1.0, channels.smooth_H.row(j));
    }
    for (i64 i = 0; i < j; ++i) {
        if (channels.smooth_s(j, i) != 0.0) {
            filling::accumulate(of_argument.row(k), channels.smooth_s(j, i), change.row(1, i, k));
        }
    }
    for (i64 c = 0, c_end = k + 1; c < c_end; ++c) {
        filling::accumulate(of_value.row(k), slope(k - c, j), of_argument.row(c));
    }
}

/// Add to coefficient k of the change of channel j what a parameter changes in its argument and in its scale.
void channel_by(const Channels& channels, const Numbers& by, i64 j, i64 k, Matrix X, Vector H, Matrix Sg, Matrix slope,
    View<double, 4> change) {
    i64 last = change.shape(3) - 1;
    change(0, j, k, last) += epp::argument(by, j, k, X, H, Sg);
    // The convolution with the slope again, of the part that was added; all channels are proportional to their scale.
    change(1, j, k, last) = 0.0;
    for (i64 c = 0, c_end = k + 1; c < c_end; ++c) {
        change(1, j, k, last) += slope(k - c, j) * change(0, j, c, last);
    }
    if (channels.smooth_scale(j) != 0.0) {
        change(1, j, k, last) += by.smooth_scale(j) / channels.smooth_scale(j) * Sg(k, j);
    }
}

/// Whether the series of the change with a parameter has ended, by its own size; where there is none it has.
bool ends(Matrices V, i64 column) {
    double size = 0.0;
    double tail = 0.0;
    if (V.shape(2) > column) {
        for (i64 k = 0; k < ORDER; ++k) {
            for (i64 i = 0; i < V.shape(1); ++i) {
                size = greatest_of(size, std::fabs(V(k, i, column)));
                if (k >= (ORDER - 2)) {
                    tail = greatest_of(tail, std::fabs(V(k, i, column)));
                }
            }
        }
    }
    return tail <= (EPS * size);
}

/// Series of state and derivative over the step h, all but the last order.
///
/// Returns 0 when they do not converge, 2 when they do over twice the step, too, else 1.
i64 series(const Channels& channels, Vector sense, Matrix F, Matrix S, Vector H, double h, Matrix X, Matrices V,
    Matrices workspace, View<double, 4> change, const Numbers& by) {
    i64 kind{};
    double factor{}, v{};
    i64 n = F.shape(0);
    i64 N = F.shape(1);
    i64 n_s = S.shape(1);
    Matrix Sg = workspace.row(0);
    Matrix arg = workspace.row(1);
    Matrix aux = workspace.row(2);
    Matrix slope = workspace.row(3);
    double size = filling::largest(X.slice(0, 1)) + 1e-300;
    double size_v = filling::largest(V.cut(0, ALL, Span{0, N}));
    for (i64 k = 0, k_end = ORDER - 1; k < k_end; ++k) {
        for (i64 j = 0; j < n_s; ++j) {
            if (channels.smooth_kind(j) != DELAY_LINE) {
                channel_term(channels, sense, j, k, X, H, Sg, arg, aux, slope);
            }
        }
        factor = h / (k + 1);
        for (i64 i = 0; i < n; ++i) {
            v = 0.0;
            for (i64 j = 0; j < n; ++j) {
                v += F(i, j) * X(k, j);
            }
            if (k == 0) {
                for (i64 j = 0; j < H.size(); ++j) {
                    v += F(i, n + j) * H(j);
                }
            }
            for (i64 j = 0; j < n_s; ++j) {
                v += S(i, j) * Sg(k, j);
            }
            X(k + 1, i) = v * factor;
        }
        V.row(k + 1).fill(0.0);
        for (i64 i = 0; i < n; ++i) {
            for (i64 c = 0; c < n; ++c) {
                if (F(i, c) != 0.0) {
                    filling::accumulate(V.row(k + 1, i), F(i, c), V.row(k, c));
                }
            }
            if (k == 0) {
                filling::accumulate(V.row(1, i).slice(n, N), 1.0, F.row(i).slice(n, F.shape(1)));
            }
        }
        if (V.shape(2) > N) {
            rate_by(by, k, X, H, Sg, V);
        }
        for (i64 j = 0; j < n_s; ++j) {
            if (channels.smooth_kind(j) == DELAY_LINE) {
                continue;
            }
            change_term(channels, j, k, V, slope, change, N);
            if (V.shape(2) > N) {
                channel_by(channels, by, j, k, X, H, Sg, slope, change);
            }
            for (i64 i = 0; i < n; ++i) {
                filling::accumulate(V.row(k + 1, i), S(i, j), change.row(1, j, k));
            }
        }
        for (i64 i = 0; i < n; ++i) {
            for (i64 j = 0; j < V.shape(2); ++j) {
                V(k + 1, i, j) *= factor;
            }
        }
    }
    // Two terms: of an odd or even motion every other one is zero. The derivative by its own series is as exact as the
    // flow, so that Newton's method ends at rounding (docs/theory/exact_orbits.md, Closing an orbit).
    double tail = filling::largest(X.slice(ORDER - 1, ORDER)) + filling::largest(X.slice(ORDER - 2, ORDER - 1));
    double tail_v = filling::largest(V.cut(ORDER - 1, ALL, Span{0, N})) + filling::largest(V.cut(ORDER - 2, ALL,
        Span{0, N}));
    if (!(tail <= (0.5 * EPS * size) && tail_v <= (EPS * size_v) && ends(V, N))) {
        return 0;
    }
    for (i64 j = 0; j < n_s; ++j) {
        kind = channels.smooth_kind(j);
        if (TANH <= kind && kind <= EXPONENTIAL) {
            if (epp::hides(kind, j, ORDER - 2, EPS, channels.smooth_scale(j), Sg, arg, aux)) {
                return 0;
            }
        }
    }
    double grown = whole_power(2.0, ORDER);
    return ((tail * grown) <= (0.5 * EPS * size) && (tail_v * grown) <= (EPS * size_v)) ? 2 : 1;
}

/// Series of state and derivative at the end of their step, into the place of the last order; small terms first.
void add_up(Matrix X, Matrices V) {
    for (i64 k = ORDER - 1; k > -1; --k) {
        filling::accumulate(X.row(ORDER), 1.0, X.row(k));
        for (i64 i = 0; i < X.shape(1); ++i) {
            filling::accumulate(V.row(ORDER, i), 1.0, V.row(k, i));
        }
    }
}

/// Values and slopes of the smooth channels at the end of an arc.
void channels_at(const Channels& model, i64 arc, Vector x, Vector H, Vector sigma, Vector slope) {
    i64 kind{};
    double scale{}, a{}, value{}, rate{};
    Vector sense = model.sense.row(arc);
    for (i64 j = 0; j < sigma.size(); ++j) {
        kind = model.smooth_kind(j);
        scale = model.smooth_scale(j);
        a = 0.0;
        for (i64 i = 0; i < x.size(); ++i) {
            a += model.smooth_x(j, i) * x(i);
        }
        for (i64 i = 0; i < H.size(); ++i) {
            a += model.smooth_H(j, i) * H(i);
        }
        for (i64 i = 0; i < j; ++i) {
            a += model.smooth_s(j, i) * sigma(i);
        }
        if (kind == SINE) {
            {
                const double was1 = scale * std::sin(a);
                const double was2 = scale * std::cos(a);
                sigma(j) = was1;
                slope(j) = was2;
            }
        } else if (kind == CUBE) {
            sigma(j) = scale * whole_power(a, 3);
            slope(j) = 3.0 * scale * a * a;
        } else if (SQUARE <= kind && kind < DELAY_LINE) {
            std::tie(value, rate) = epp::curve(kind, a);
            sigma(j) = scale * value;
            slope(j) = scale * rate;
        } else if (kind != DELAY_LINE) {
            sigma(j) = scale / (1.0 + sense(j) * a);
            slope(j) = (scale != 0.0) ? -sense(j) * sigma(j) * sigma(j) / scale : 0.0;
        }
    }
}

/// State at the end of an arc with smooth channels, its derivative, and there the channels with their slopes.
///
/// The derivative Phi (N, N) is that by the state at the begin. With one more column (N, N + 1) it holds the change
/// with a parameter of which `by` has the derivatives, too.
///
/// Returns the number of series made. The end is not a number where it is not reached with `most` of them: the stiffer
/// the motion, the shorter its series.
i64 smooth_flow(const Channels& channels, i64 arc, Matrix F, Matrix S, Vector y, double tau, i64 most, Vector end,
    Matrix Phi, Vector sigma, Vector slope, const Numbers& by) {
    Scope scope;
    i64 holds{};
    double h{};
    Vector sense = channels.sense.row(arc);
    i64 n = F.shape(0);
    i64 N = F.shape(1);
    i64 n_s = S.shape(1);
    Vector H = copy_of(y.slice(n, y.shape(0)));
    i64 columns = Phi.shape(1);
    Matrix X = zeros<double>(ORDER + 1, n);
    Matrices V = zeros<double>(ORDER + 1, n, columns);
    Matrices workspace = zeros<double>(4, ORDER + 1, n_s);
    View<double, 4> change = zeros<double>(2, n_s, ORDER + 1, columns);
    Matrices square = zeros<double>(3, padded(n), padded(n));
    filling::fill_rows(square.cut(0, Span{0, n}, Span{0, n}), F);
    double rate = epp::growth_rate(square.row(0), square.row(1), square.row(2));
    Vector x = copy_of(y.slice(0, n));
    Matrix P = zeros<double>(n, columns);
    for (i64 i = 0; i < n; ++i) {
        P(i, i) = 1.0;
    }
    double done = 0.0;
    double d = std::fabs(tau);
    // Series are tried over times in which no power of F grows; longer ones would not converge to rounding.
    while ((rate * d) > 1.0) {
        d *= 0.5;
    }
    if (tau < 0.0) {
        d = -d;
    }
    double longest = d;
    i64 made = 0;
    bool last = false;
    while (!last) {
        last = std::fabs(done + d) >= (std::fabs(tau) * (1.0 - 1e-14));
        h = last ? tau - done : d;
        if (made >= most || !(std::fabs(d) >= (1e-15 * std::fabs(tau)))) {
            x.fill(NaN);
            P.fill(NaN);
            break;
        }
        filling::fill(X.row(0), x);
        filling::fill_rows(V.row(0), P);
        made += 1;
        holds = series(channels, sense, F, S, H, h, X, V, workspace, change, by);
        if (holds == 0) {
            d = 0.5 * h;
            last = false;
            continue;
        }
        add_up(X, V);
        filling::fill(x, X.row(ORDER));
        filling::fill_rows(P, V.row(ORDER));
        X.row(ORDER).fill(0.0);
        V.row(ORDER).fill(0.0);
        done += h;
        // Deep in saturation series are short near the switch alone, those of a power near rest: they grow behind it.
        if (holds == 2 && std::fabs(d) < std::fabs(longest)) {
            d *= 2.0;
        }
    }
    filling::fill(end.slice(0, n), x);
    filling::fill(end.slice(n, end.shape(0)), H);
    Phi.fill(0.0);
    filling::fill_rows(Phi.slice(0, n), P);
    for (i64 i = n; i < N; ++i) {
        Phi(i, i) = 1.0;
    }
    channels_at(channels, arc, x, H, sigma, slope);
    return made;
}

/// Values and slopes of the smooth channels at the end of an arc.
void channels_at(None model, i64 arc, Vector x, Vector H, Vector sigma, Vector slope) {
    return;
}

/// Change of the state along an affine arc with a parameter, from that at its begin; `by` holds the derivatives.
///
/// The rate of change moves with the state's rate by the exponential of [[F, 0], [by, F]], which holds the Frechet
/// derivative of the exponential of F. Where the parameter moves constants alone, F is alone there.
void affine_change(Matrix F, Matrix by, Vector y, double tau, Vector change, Vector end) {
    Scope scope;
    i64 n = F.shape(0);
    i64 N = F.shape(1);
    i64 moving = 1;
    i64 own = 0;
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < n; ++j) {
            if (F(i, j) != 0.0 || by(i, j) != 0.0) {
                moving = greatest_of<i64>(greatest_of<i64>(moving, i + 1), j + 1);
            }
            own = (by(i, j) != 0.0) ? 1 : own;
        }
    }
    filling::fill(end, change);
    if (tau == 0.0) {
        return;
    }
    own *= moving;
    Matrices square = zeros<double>(8, padded(own + moving), padded(own + moving));
    Matrix M = square.row(0);
    Matrix integral = square.row(1);
    Vector rates = zeros<double>(2 * n);
    for (i64 i = 0; i < n; ++i) {
        for (i64 j = 0; j < N; ++j) {
            rates(i) += F(i, j) * y(j);
            rates(n + i) += by(i, j) * y(j) + F(i, j) * change(j);
        }
    }
    for (i64 i = 0; i < moving; ++i) {
        for (i64 j = 0; j < moving; ++j) {
            const double was1 = F(i, j);
            M(i, j) = was1;
            M(own + i, own + j) = was1;
            if (own) {
                M(own + i, j) = by(i, j);
            }
        }
    }
    epp::flow(M, tau, epp::growth_rate(M, square.row(3), square.row(4)), integral, square.row(2), square.row(5),
        square.row(6), square.row(7));
    for (i64 i = 0; i < moving; ++i) {
        for (i64 j = 0; j < moving; ++j) {
            end(i) += integral(own + i, own + j) * rates(n + j);
            if (own) {
                end(i) += integral(own + i, j) * rates(j);
            }
        }
    }
    for (i64 i = moving; i < n; ++i) {
        end(i) += tau * rates(n + i);
    }
}

}  // namespace orbits_flow
}  // namespace EPP_ARCH
}  // namespace epp
