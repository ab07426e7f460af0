/* Units for tests, with the functions of Model Exchange of FMI 2 and 3 and, for Co-Simulation, what a linearisation
   needs. MODEL: 1 a drive, linear; 2 a pendulum; 3 a drive behind a limit that switches by an event; 4 van der Pol's
   oscillator with the numbers of the reference unit VanDerPol, and inputs. DIRECTIONAL: whether it gives directional
   derivatives. References: states 0 1, rates 2 3, inputs 4 5, outputs 6 7 8, parameter 9. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double v[10];
    int limited; /* of model 3: the side of the limit */
} Unit;

static void evaluate(Unit *unit) {
    double *v = unit->v, torque = v[4];
#if MODEL == 2
    v[2] = v[1];
    v[3] = (v[4] - 0.4 * v[1] - 3.0 * sin(v[0])) / v[9];
#elif MODEL == 4
    v[2] = v[1];
    v[3] = v[9] * (1.0 - v[0] * v[0]) * v[1] - v[0] + v[4] + v[5];
#else
#if MODEL == 3
    torque = unit->limited ? unit->limited : v[4];
#endif
    v[2] = v[1];
    v[3] = (torque - 0.7 * v[1] - 1.3 * v[0] + v[5]) / v[9];
#endif
    v[6] = v[0];
    v[7] = v[1] + 0.25 * v[5];
    v[8] = v[3];
}
static void events(Unit *unit) { unit->limited = unit->v[4] > 1.0 ? 1 : unit->v[4] < -1.0 ? -1 : 0; }

static void *make(void) {
    Unit *unit = calloc(1, sizeof(Unit));
    unit->v[9] = 0.5;
#if MODEL == 2
    unit->v[0] = 0.2;
    unit->v[4] = 1.5;
#elif MODEL == 4
    unit->v[0] = 2.0;
    unit->v[9] = 1.0;
#endif
    return unit;
}
static int get(void *c, const unsigned *r, size_t n, double *to) {
    evaluate(c);
    for (size_t i = 0; i < n; ++i) to[i] = ((Unit *)c)->v[r[i]];
    return 0;
}
static int set(void *c, const unsigned *r, size_t n, const double *to) {
    for (size_t i = 0; i < n; ++i) {
        if (r[i] == 9 && !(to[i] > 0.0)) return 3;
        ((Unit *)c)->v[r[i]] = to[i];
    }
    return 0;
}
static int directional(void *c, const unsigned *z, size_t n, const unsigned *r, const double *seed, double *to) {
    Unit *unit = c;
    double inertia = unit->v[9], spring = 1.3, damping = 0.7, angle = 0, speed = 0, torque = 0, load = 0;
#if MODEL == 2
    spring = 3.0 * cos(unit->v[0]), damping = 0.4;
#elif MODEL == 4
    double *x = unit->v, mu = x[9];
    spring = 1.0 + 2.0 * mu * x[0] * x[1], damping = mu * (x[0] * x[0] - 1.0), inertia = 1.0;
#endif
    angle = *r == 0 ? *seed : 0, speed = *r == 1 ? *seed : 0, torque = *r == 4 ? *seed : 0, load = *r == 5 ? *seed : 0;
    double rate = (torque - damping * speed - spring * angle + (MODEL == 2 ? 0 : load)) / inertia;
    double of[] = {angle, speed, speed, rate, torque, load, angle, speed + 0.25 * load, rate};
#if MODEL == 4
    of[0] = of[1] = 0; /* it knows the derivatives of its equations alone, as the reference unit does */
#endif
    for (size_t i = 0; i < n; ++i) to[i] = of[z[i]];
    return 0;
}

#include "absent.h"

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
MAKE(fmi2Instantiate)
FREE(fmi2FreeInstance)
FINE(fmi2SetupExperiment)
FINE(fmi2EnterInitializationMode)
FINE(fmi2ExitInitializationMode)
FINE(fmi2EnterEventMode)
FINE(fmi2EnterContinuousTimeMode)
typedef struct { int needed, terminate, nominals, values, defined; double next; } Events2;
int fmi2NewDiscreteStates(void *c, Events2 *info) {
    events(c);
    memset(info, 0, sizeof *info);
    return 0;
}
int fmi2GetReal(void *c, const unsigned *r, size_t n, double *to) { return get(c, r, n, to); }
int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *to) { return set(c, r, n, to); }
int fmi2SetContinuousStates(void *c, const double *x, size_t n) { return set(c, (unsigned[]){0, 1}, n, x); }
#if DIRECTIONAL
int fmi2GetDirectionalDerivative(void *c, const unsigned *z, size_t nz, const unsigned *r, size_t nr, const double *seed,
    double *to) { return directional(c, z, nz, r, seed, to); }
#endif

const char *fmi3GetVersion(void) { return "3.0"; }
MAKE(fmi3InstantiateModelExchange)
MAKE(fmi3InstantiateCoSimulation)
FREE(fmi3FreeInstance)
FINE(fmi3EnterInitializationMode)
FINE(fmi3ExitInitializationMode)
FINE(fmi3EnterEventMode)
FINE(fmi3EnterContinuousTimeMode)
int fmi3UpdateDiscreteStates(void *c, _Bool *needed, _Bool *terminate, _Bool *nominals, _Bool *values, _Bool *defined,
    double *next) {
    events(c);
    *needed = *terminate = *nominals = *values = *defined = 0;
    *next = 0.0;
    return 0;
}
int fmi3GetFloat64(void *c, const unsigned *r, size_t n, double *to, size_t m) { return get(c, r, n, to); }
int fmi3SetFloat64(void *c, const unsigned *r, size_t n, const double *to, size_t m) { return set(c, r, n, to); }
int fmi3SetContinuousStates(void *c, const double *x, size_t n) { return set(c, (unsigned[]){0, 1}, n, x); }
#if DIRECTIONAL
int fmi3GetDirectionalDerivative(void *c, const unsigned *z, size_t nz, const unsigned *r, size_t nr, const double *seed,
    size_t ns, double *to, size_t nt) { return directional(c, z, nz, r, seed, to); }
#endif

NONE(fmi3EnterConfigurationMode) NONE(fmi3ExitConfigurationMode) NONE(fmi3SetUInt64)
