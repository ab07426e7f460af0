#pragma once
// Fields of the tables, in the order in which Python has them.

#include "structures.hpp"

namespace epp {
inline namespace EPP_ARCH {

template <class T> struct Fields;

template <> struct Fields<Chain> {
    template <class Visit> static void each(Chain& t, Visit&& visit) {
        visit("Chain.F", t.F);
        visit("Chain.S", t.S);
        visit("Chain.g", t.g);
        visit("Chain.gs", t.gs);
        visit("Chain.J", t.J);
        visit("Chain.smooth", t.smooth);
        visit("Chain.at_once", t.at_once);
        visit("Chain.free", t.free);
        visit("Chain.shift", t.shift);
        visit("Chain.duration", t.duration);
    }
};
template <> struct Fields<Met> {
    template <class Visit> static void each(Met& t, Visit&& visit) {
        visit("Met.time", t.time);
        visit("Met.guard", t.guard);
        visit("Met.state", t.state);
        visit("Met.memory", t.memory);
        visit("Met.modes", t.modes);
    }
};

template <> struct Fields<Channels> {
    template <class Visit> static void each(Channels& t, Visit&& visit) {
        visit("Channels.smooth_kind", t.smooth_kind);
        visit("Channels.smooth_x", t.smooth_x);
        visit("Channels.smooth_H", t.smooth_H);
        visit("Channels.smooth_s", t.smooth_s);
        visit("Channels.smooth_scale", t.smooth_scale);
        visit("Channels.sense", t.sense);
    }
};
template <> struct Fields<Combinations> {
    template <class Visit> static void each(Combinations& t, Visit&& visit) {
        visit("Combinations.count", t.count);
        visit("Combinations.key", t.key);
        visit("Combinations.linear", t.linear);
        visit("Combinations.step", t.step);
        visit("Combinations.rate", t.rate);
        visit("Combinations.ready", t.ready);
        visit("Combinations.M", t.M);
        visit("Combinations.M_twice", t.M_twice);
        visit("Combinations.M_size", t.M_size);
        visit("Combinations.entries", t.entries);
        visit("Combinations.row", t.row);
        visit("Combinations.row_end", t.row_end);
        visit("Combinations.spread_rate", t.spread_rate);
        visit("Combinations.far", t.far);
        visit("Combinations.y_entries", t.y_entries);
        visit("Combinations.y_row", t.y_row);
        visit("Combinations.y_row_end", t.y_row_end);
        visit("Combinations.N", t.N);
        visit("Combinations.S", t.S);
        visit("Combinations.Wx", t.Wx);
        visit("Combinations.WH", t.WH);
        visit("Combinations.Ws", t.Ws);
        visit("Combinations.Zx", t.Zx);
        visit("Combinations.ZH", t.ZH);
        visit("Combinations.Zs", t.Zs);
        visit("Combinations.Y", t.Y);
        visit("Combinations.YH", t.YH);
        visit("Combinations.Ys", t.Ys);
        visit("Combinations.n_guards", t.n_guards);
        visit("Combinations.guard", t.guard);
        visit("Combinations.next", t.next);
        visit("Combinations.ga", t.ga);
        visit("Combinations.ga_count", t.ga_count);
        visit("Combinations.ga_place", t.ga_place);
        visit("Combinations.ga_size", t.ga_size);
        visit("Combinations.gb", t.gb);
        visit("Combinations.gb_size", t.gb_size);
        visit("Combinations.on_rate", t.on_rate);
        visit("Combinations.gH", t.gH);
        visit("Combinations.gs", t.gs);
        visit("Combinations.gt", t.gt);
        visit("Combinations.smooth_guard", t.smooth_guard);
        visit("Combinations.gf", t.gf);
        visit("Combinations.gfH", t.gfH);
        visit("Combinations.all_gf", t.all_gf);
        visit("Combinations.reach_gf", t.reach_gf);
        visit("Combinations.T", t.T);
        visit("Combinations.bound", t.bound);
        visit("Combinations.longs", t.longs);
        visit("Combinations.T_long", t.T_long);
        visit("Combinations.reach", t.reach);
    }
};
template <> struct Fields<Curve> {
    template <class Visit> static void each(Curve& t, Visit&& visit) {
        visit("Curve.middle", t.middle);
        visit("Curve.half", t.half);
        visit("Curve.base", t.base);
        visit("Curve.places", t.places);
        visit("Curve.coefficients", t.coefficients);
    }
};
template <> struct Fields<Effort> {
    template <class Visit> static void each(Effort& t, Visit&& visit) {
        visit("Effort.most", t.most);
        visit("Effort.sweep", t.sweep);
        visit("Effort.series", t.series);
    }
};
template <> struct Fields<EventBuffer> {
    template <class Visit> static void each(EventBuffer& t, Visit&& visit) {
        visit("EventBuffer.t", t.t);
        visit("EventBuffer.guard", t.guard);
        visit("EventBuffer.x", t.x);
        visit("EventBuffer.v", t.v);
        visit("EventBuffer.H", t.H);
        visit("EventBuffer.modes", t.modes);
    }
};
template <> struct Fields<Model> {
    template <class Visit> static void each(Model& t, Visit&& visit) {
        visit("Model.A", t.A);
        visit("Model.B", t.B);
        visit("Model.S", t.S);
        visit("Model.K", t.K);
        visit("Model.C", t.C);
        visit("Model.D", t.D);
        visit("Model.Kz", t.Kz);
        visit("Model.first", t.first);
        visit("Model.order", t.order);
        visit("Model.reach", t.reach);
        visit("Model.mode_first", t.mode_first);
        visit("Model.mode_wz", t.mode_wz);
        visit("Model.mode_wh", t.mode_wh);
        visit("Model.mode_ws", t.mode_ws);
        visit("Model.mode_w0", t.mode_w0);
        visit("Model.mode_stick", t.mode_stick);
        visit("Model.mode_lags", t.mode_lags);
        visit("Model.mode_level", t.mode_level);
        visit("Model.guard_first", t.guard_first);
        visit("Model.guard_element", t.guard_element);
        visit("Model.guard_target", t.guard_target);
        visit("Model.guard_bypass", t.guard_bypass);
        visit("Model.guard_z", t.guard_z);
        visit("Model.guard_rate", t.guard_rate);
        visit("Model.guard_h", t.guard_h);
        visit("Model.guard_w", t.guard_w);
        visit("Model.guard_0", t.guard_0);
        visit("Model.reset_z", t.reset_z);
        visit("Model.reset_h", t.reset_h);
        visit("Model.reset_0", t.reset_0);
        visit("Model.guard_impulse", t.guard_impulse);
        visit("Model.smooth_kind", t.smooth_kind);
        visit("Model.smooth_x", t.smooth_x);
        visit("Model.smooth_H", t.smooth_H);
        visit("Model.smooth_s", t.smooth_s);
        visit("Model.smooth_scale", t.smooth_scale);
        visit("Model.smooth_w", t.smooth_w);
        visit("Model.smooth_delay", t.smooth_delay);
        visit("Model.Yx", t.Yx);
        visit("Model.Yw", t.Yw);
        visit("Model.YH", t.YH);
        visit("Model.breakpoint_time", t.breakpoint_time);
        visit("Model.breakpoint_state", t.breakpoint_state);
        visit("Model.breakpoint_value", t.breakpoint_value);
        visit("Model.breakpoint_memory", t.breakpoint_memory);
        visit("Model.breakpoint_slope", t.breakpoint_slope);
    }
};
template <> struct Fields<Models> {
    template <class Visit> static void each(Models& t, Visit&& visit) {
        visit("Models.A", t.A);
        visit("Models.B", t.B);
        visit("Models.S", t.S);
        visit("Models.K", t.K);
        visit("Models.C", t.C);
        visit("Models.D", t.D);
        visit("Models.Kz", t.Kz);
        visit("Models.first", t.first);
        visit("Models.order", t.order);
        visit("Models.reach", t.reach);
        visit("Models.mode_first", t.mode_first);
        visit("Models.mode_wz", t.mode_wz);
        visit("Models.mode_wh", t.mode_wh);
        visit("Models.mode_ws", t.mode_ws);
        visit("Models.mode_w0", t.mode_w0);
        visit("Models.mode_stick", t.mode_stick);
        visit("Models.mode_lags", t.mode_lags);
        visit("Models.mode_level", t.mode_level);
        visit("Models.guard_first", t.guard_first);
        visit("Models.guard_element", t.guard_element);
        visit("Models.guard_target", t.guard_target);
        visit("Models.guard_bypass", t.guard_bypass);
        visit("Models.guard_z", t.guard_z);
        visit("Models.guard_rate", t.guard_rate);
        visit("Models.guard_h", t.guard_h);
        visit("Models.guard_w", t.guard_w);
        visit("Models.guard_0", t.guard_0);
        visit("Models.reset_z", t.reset_z);
        visit("Models.reset_h", t.reset_h);
        visit("Models.reset_0", t.reset_0);
        visit("Models.guard_impulse", t.guard_impulse);
        visit("Models.smooth_kind", t.smooth_kind);
        visit("Models.smooth_x", t.smooth_x);
        visit("Models.smooth_H", t.smooth_H);
        visit("Models.smooth_s", t.smooth_s);
        visit("Models.smooth_scale", t.smooth_scale);
        visit("Models.smooth_w", t.smooth_w);
        visit("Models.smooth_delay", t.smooth_delay);
        visit("Models.Yx", t.Yx);
        visit("Models.Yw", t.Yw);
        visit("Models.YH", t.YH);
        visit("Models.breakpoint_time", t.breakpoint_time);
        visit("Models.breakpoint_state", t.breakpoint_state);
        visit("Models.breakpoint_value", t.breakpoint_value);
        visit("Models.breakpoint_memory", t.breakpoint_memory);
        visit("Models.breakpoint_slope", t.breakpoint_slope);
    }
};
template <> struct Fields<Motion> {
    template <class Visit> static void each(Motion& t, Visit&& visit) {
        visit("Motion.y", t.y);
        visit("Motion.tau", t.tau);
        visit("Motion.starts", t.starts);
        visit("Motion.ends", t.ends);
        visit("Motion.A", t.A);
        visit("Motion.r", t.r);
        visit("Motion.speed", t.speed);
        visit("Motion.scale", t.scale);
        visit("Motion.rows", t.rows);
    }
};
template <> struct Fields<Outcome> {
    template <class Visit> static void each(Outcome& t, Visit&& visit) {
        visit("Outcome.code", t.code);
        visit("Outcome.verdict", t.verdict);
        visit("Outcome.events", t.events);
        visit("Outcome.since", t.since);
        visit("Outcome.period", t.period);
        visit("Outcome.change", t.change);
        visit("Outcome.mean", t.mean);
        visit("Outcome.low", t.low);
        visit("Outcome.high", t.high);
        visit("Outcome.rms", t.rms);
        visit("Outcome.stop", t.stop);
    }
};
template <> struct Fields<Pieces> {
    template <class Visit> static void each(Pieces& t, Visit&& visit) {
        visit("Pieces.edges", t.edges);
        visit("Pieces.modes", t.modes);
        visit("Pieces.memory", t.memory);
        visit("Pieces.fired", t.fired);
    }
};
template <> struct Fields<Plane> {
    template <class Visit> static void each(Plane& t, Visit&& visit) {
        visit("Plane.row", t.row);
        visit("Plane.old", t.old);
        visit("Plane.distance", t.distance);
        visit("Plane.slope", t.slope);
        visit("Plane.largest", t.largest);
        visit("Plane.longest", t.longest);
    }
};
template <> struct Fields<Rules> {
    template <class Visit> static void each(Rules& t, Visit&& visit) {
        visit("Rules.from_input", t.from_input);
        visit("Rules.from_memory", t.from_memory);
        visit("Rules.from_smooth", t.from_smooth);
        visit("Rules.constant", t.constant);
        visit("Rules.smooth_kind", t.smooth_kind);
        visit("Rules.smooth_input", t.smooth_input);
        visit("Rules.smooth_constant", t.smooth_constant);
        visit("Rules.smooth_scale", t.smooth_scale);
        visit("Rules.guard_mode", t.guard_mode);
        visit("Rules.target", t.target);
        visit("Rules.on_input", t.on_input);
        visit("Rules.on_rate", t.on_rate);
        visit("Rules.on_memory", t.on_memory);
        visit("Rules.on_output", t.on_output);
        visit("Rules.guard_constant", t.guard_constant);
        visit("Rules.memory_from_input", t.memory_from_input);
        visit("Rules.memory_from_memory", t.memory_from_memory);
        visit("Rules.memory_constant", t.memory_constant);
        visit("Rules.start", t.start);
    }
};
template <> struct Fields<Samples> {
    template <class Visit> static void each(Samples& t, Visit&& visit) {
        visit("Samples.times", t.times);
        visit("Samples.rows", t.rows);
        visit("Samples.out", t.out);
        visit("Samples.phases", t.phases);
        visit("Samples.order", t.order);
        visit("Samples.bins", t.bins);
    }
};
template <> struct Fields<Table> {
    template <class Visit> static void each(Table& t, Visit&& visit) {
        visit("Table.roles", t.roles);
        visit("Table.first", t.first);
        visit("Table.series", t.series);
        visit("Table.factor", t.factor);
        visit("Table.constant", t.constant);
        visit("Table.on_memory", t.on_memory);
        visit("Table.on_clock", t.on_clock);
        visit("Table.target", t.target);
        visit("Table.from_input", t.from_input);
        visit("Table.from_memory", t.from_memory);
        visit("Table.memory_constant", t.memory_constant);
        visit("Table.on_free", t.on_free);
        visit("Table.on_rate", t.on_rate);
        visit("Table.free_series", t.free_series);
        visit("Table.rate_series", t.rate_series);
        visit("Table.w_free", t.w_free);
        visit("Table.w_rate", t.w_rate);
        visit("Table.w_memory", t.w_memory);
        visit("Table.w_constant", t.w_constant);
    }
};
template <> struct Fields<Work> {
    template <class Visit> static void each(Work& t, Visit&& visit) {
        visit("Work.E", t.E);
        visit("Work.F", t.F);
        visit("Work.rate", t.rate);
        visit("Work.inputs", t.inputs);
        visit("Work.signals", t.signals);
        visit("Work.square", t.square);
        visit("Work.guards", t.guards);
    }
};
template <> struct Fields<Workspace> {
    template <class Visit> static void each(Workspace& t, Visit&& visit) {
        visit("Workspace.X", t.X);
        visit("Workspace.Y", t.Y);
        visit("Workspace.Z", t.Z);
        visit("Workspace.Sg", t.Sg);
        visit("Workspace.arg", t.arg);
        visit("Workspace.aux", t.aux);
        visit("Workspace.p", t.p);
        visit("Workspace.still", t.still);
        visit("Workspace.x", t.x);
        visit("Workspace.modes", t.modes);
        visit("Workspace.H", t.H);
        visit("Workspace.rate", t.rate);
        visit("Workspace.low", t.low);
        visit("Workspace.high", t.high);
        visit("Workspace.largest", t.largest);
        visit("Workspace.recent", t.recent);
        visit("Workspace.spread", t.spread);
        visit("Workspace.push", t.push);
        visit("Workspace.slope", t.slope);
        visit("Workspace.speed", t.speed);
        visit("Workspace.small", t.small);
        visit("Workspace.wide", t.wide);
        visit("Workspace.one", t.one);
        visit("Workspace.memory", t.memory);
        visit("Workspace.constant", t.constant);
        visit("Workspace.lift", t.lift);
        visit("Workspace.g0", t.g0);
        visit("Workspace.g1", t.g1);
        visit("Workspace.tol", t.tol);
        visit("Workspace.stray", t.stray);
        visit("Workspace.top", t.top);
        visit("Workspace.end", t.end);
        visit("Workspace.watch", t.watch);
        visit("Workspace.line_t", t.line_t);
        visit("Workspace.line_h", t.line_h);
        visit("Workspace.line_c", t.line_c);
        visit("Workspace.line_n", t.line_n);
        visit("Workspace.behind_x", t.behind_x);
        visit("Workspace.behind_modes", t.behind_modes);
        visit("Workspace.behind_H", t.behind_H);
        visit("Workspace.behind_recent", t.behind_recent);
        visit("Workspace.once", t.once);
        visit("Workspace.then_x", t.then_x);
        visit("Workspace.then_modes", t.then_modes);
        visit("Workspace.then_H", t.then_H);
        visit("Workspace.before", t.before);
    }
};

}  // namespace EPP_ARCH
}  // namespace epp
