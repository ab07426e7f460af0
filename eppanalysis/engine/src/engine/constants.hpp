#pragma once
// Constants of the run.

#include "rows.hpp"

namespace epp {
inline namespace EPP_ARCH {

alignas(64) inline double AFTER_numbers[] = {0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
    1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
    1.0, 1.0};
inline const Vector AFTER(AFTER_numbers, {40});
constexpr double ALWAYS = 1e+300;
constexpr double APART = 1e-07;
constexpr i64 ARCTAN = 7;
constexpr double CLEAR = 1e-09;
constexpr double CONTINUES = 1.7763568394002505e-15;
constexpr i64 CUBE = 1;
alignas(64) inline double CURVATURE_numbers[] = {-0.0, 0.0, 2.0, 6.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0, 90.0, 110.0,
    132.0, 156.0, 182.0, 210.0, 240.0, 272.0, 306.0, 342.0, 380.0, 420.0, 462.0, 506.0, 552.0, 600.0, 650.0, 702.0,
    756.0, 812.0, 870.0, 930.0, 992.0, 1056.0, 1122.0, 1190.0, 1260.0, 1332.0, 1406.0, 1482.0};
inline const Vector CURVATURE(CURVATURE_numbers, {40});
constexpr double DECAYED = 500.0;
constexpr i64 DELAY_LINE = 11;
constexpr i64 DIVERGED = 2;
constexpr i64 DONE = 0;
constexpr double EPS = 2.220446049250313e-16;
constexpr i64 EVENT_AHEAD = 1;
constexpr i64 EVENT_LIMIT = 1;
constexpr i64 EXPONENTIAL = 10;
constexpr i64 FIFTH = 5;
constexpr i64 FOURTH = 4;
constexpr i64 GAUSSIAN = 8;
constexpr double GONE = 24.0;
constexpr i64 GROWS = 19;
constexpr i64 HISTORY = 5;
constexpr double INSTANT = 1e-12;
constexpr double LARGEST = 1e+100;
constexpr double LEAST = 5e-11;
constexpr i64 LOGARITHM = 9;
constexpr i64 LONGS = 4;
constexpr i64 LONG_AHEAD = 2;
constexpr i64 LONG_DOUBLINGS = 4;
constexpr i64 LONG_QUIET = 16;
alignas(64) inline double MINUS_CURVATURE_numbers[] = {0.0, -0.0, -2.0, -6.0, -12.0, -20.0, -30.0, -42.0, -56.0, -72.0,
    -90.0, -110.0, -132.0, -156.0, -182.0, -210.0, -240.0, -272.0, -306.0, -342.0, -380.0, -420.0, -462.0, -506.0,
    -552.0, -600.0, -650.0, -702.0, -756.0, -812.0, -870.0, -930.0, -992.0, -1056.0, -1122.0, -1190.0, -1260.0,
    -1332.0, -1406.0, -1482.0};
inline const Vector MINUS_CURVATURE(MINUS_CURVATURE_numbers, {40});
constexpr i64 MOST_EVENTS = 128;
constexpr i64 MOST_FAR = 64;
constexpr i64 MOST_TURNS = 64;
constexpr i64 MOST_UNTIMED = 2500;
constexpr double NEAR = 1e-11;
constexpr i64 OFF_GRID = 0;
constexpr i64 ORDER = 32;
constexpr i64 ORDERS = 32;
constexpr i64 PAUSED = 7;
constexpr double REACH = 3.0;
constexpr double ROUNDING = 5e-13;
constexpr double SATURATED = 20.0;
constexpr i64 SINE = 0;
constexpr i64 SINGULAR = 3;
constexpr i64 SOON = 8;
constexpr i64 SQUARE = 3;
constexpr i64 STALLED = 4;
constexpr double STAYS = 3.0;
constexpr i64 STEP_LIMIT = 6;
constexpr i64 TANH = 6;
constexpr double TRACE = 0.001;
constexpr double UNTIMED = 1e-14;

}  // namespace EPP_ARCH
}  // namespace epp
