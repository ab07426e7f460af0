/* A unit of FMI 3 with arrays: dx/dt = A x + B u, y = C x + D u, of n states, inputs and outputs, as the reference unit
   StateSpace has. Inputs jump, so that they may be set at events alone, and states between events alone; n may be set
   while the unit is configured. References: n 0, x 1, rates 2, u 3, y 4, A 5, B 6, C 7, D 8. */
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define MOST 4
enum { CONFIGURATION, START, EVENT, CONTINUOUS };
typedef struct {
    size_t n;
    int mode;
    double vector[5][MOST], matrix[9][MOST * MOST]; /* by their references */
} Unit;

static void add(const Unit *unit, double *to, const double *matrix, const double *x) {
    for (size_t i = 0; i < unit->n; ++i)
        for (size_t j = 0; j < unit->n; ++j) to[i] += matrix[i * unit->n + j] * x[j];
}
static void evaluate(Unit *unit, const double *x, const double *u, double *rates, double *y) {
    memset(rates, 0, MOST * sizeof(double));
    memset(y, 0, MOST * sizeof(double));
    add(unit, rates, unit->matrix[5], x), add(unit, rates, unit->matrix[6], u);
    add(unit, y, unit->matrix[7], x), add(unit, y, unit->matrix[8], u);
}
static void *make(void) {
    Unit *unit = calloc(1, sizeof(Unit));
    unit->n = 3;
    for (size_t k = 5; k < 9; ++k)
        for (size_t i = 0; i < 3; ++i) unit->matrix[k][4 * i] = 1.0;
    for (size_t i = 0; i < 3; ++i) unit->vector[3][i] = i + 1.0;
    unit->mode = START;
    return unit;
}
static double *place(Unit *unit, unsigned r, size_t *size) {
    *size = r < 5 ? unit->n : unit->n * unit->n;
    return r < 5 ? unit->vector[r] : unit->matrix[r];
}

#include "absent.h"

const char *fmi3GetVersion(void) { return "3.0"; }
MAKE(fmi3InstantiateModelExchange)
NONE(fmi3InstantiateCoSimulation)
FREE(fmi3FreeInstance)
#define MODE(name, to) int name(void *c) { ((Unit *)c)->mode = to; return 0; }
MODE(fmi3EnterConfigurationMode, CONFIGURATION)
MODE(fmi3ExitConfigurationMode, START)
MODE(fmi3EnterInitializationMode, START)
MODE(fmi3ExitInitializationMode, EVENT)
MODE(fmi3EnterEventMode, EVENT)
MODE(fmi3EnterContinuousTimeMode, CONTINUOUS)
int fmi3UpdateDiscreteStates(void *c, _Bool *needed, _Bool *terminate, _Bool *nominals, _Bool *values, _Bool *defined,
    double *next) {
    *needed = *terminate = *nominals = *values = *defined = 0;
    *next = 0.0;
    return 0;
}
int fmi3SetUInt64(void *c, const unsigned *r, size_t n, const unsigned long *to, size_t m) {
    Unit *unit = c;
    if (unit->mode != CONFIGURATION || *r != 0 || *to < 1 || *to > MOST) return 3;
    unit->n = *to;
    return 0;
}
int fmi3GetFloat64(void *c, const unsigned *r, size_t n, double *to, size_t m) {
    Unit *unit = c;
    evaluate(unit, unit->vector[1], unit->vector[3], unit->vector[2], unit->vector[4]);
    for (size_t i = 0, size; i < n; ++i, to += size) {
        const double *from = place(unit, r[i], &size);
        memcpy(to, from, size * sizeof(double));
    }
    return 0;
}
int fmi3SetFloat64(void *c, const unsigned *r, size_t n, const double *from, size_t m) {
    Unit *unit = c;
    for (size_t i = 0, size; i < n; ++i, from += size) {
        double *to = place(unit, r[i], &size);
        if (unit->mode == CONTINUOUS || unit->mode == CONFIGURATION || r[i] == 2 || r[i] == 4) return 3;
        memcpy(to, from, size * sizeof(double));
    }
    return 0;
}
int fmi3SetContinuousStates(void *c, const double *x, size_t n) {
    Unit *unit = c;
    if (unit->mode != CONTINUOUS || n != unit->n) return 3;
    memcpy(unit->vector[1], x, n * sizeof(double));
    return 0;
}
#if DIRECTIONAL
int fmi3GetDirectionalDerivative(void *c, const unsigned *z, size_t nz, const unsigned *r, size_t nr, const double *seed,
    size_t ns, double *to, size_t nt) {
    Unit *unit = c;
    double none[MOST] = {0}, rates[MOST], y[MOST];
    evaluate(unit, *r == 1 ? seed : none, *r == 3 ? seed : none, rates, y);
    for (size_t i = 0; i < nz; ++i, to += unit->n) memcpy(to, z[i] == 2 ? rates : y, unit->n * sizeof(double));
    return ns == unit->n && nt == nz * unit->n ? 0 : 3;
}
#endif
