/* A station of somebody else: three banks and a car, isothermal ideal gas, in kPa and Celsius; FMI 2.0 and 3.0.
   Nothing of it is the product's. VERSION is 2 or 3. */

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define OUT __attribute__((visibility("default")))
#define K (8.314462618 / 2.01588e-3) /* J/(kg K) of hydrogen */

/* References: 0-2 inlets and 3-5 outlets [%], 6 number of the car, 7 its start pressure [kPa], 8 its start temperature [K],
   10-13 pressures [kPa], 14-17 temperatures [K; of the car Celsius], 20 compressor and 21 dispenser [kg/h],
   30 misbehaviour, 31 when [s], 32 start pressure of the banks [kPa]. */
typedef struct {
    double value[40], mass[4], volume[4];
    int car;
    double time;
    void *log, *environment; /* no log unless the importer has asked for one */
} Unit;

static void tell(Unit *u, int status, const char *text) {
    if (u->log == NULL) return;
#if VERSION == 2
    ((void (*)(void *, const char *, int, const char *, const char *, ...))u->log)(
        u->environment, "foreign", status, "all", "%s", text);
#else
    ((void (*)(void *, int, const char *, const char *))u->log)(u->environment, status, "all", text);
#endif
}

static double temperature(const Unit *u, int tank) { return tank < 3 ? 290.0 + tank : u->value[8]; }

static void show(Unit *u) {
    int i;
    for (i = 0; i < 4; i++) {
        u->value[10 + i] = u->mass[i] * K * temperature(u, i) / u->volume[i] / 1000.0;
        u->value[14 + i] = i < 3 ? temperature(u, i) : temperature(u, i) - 273.15;
    }
}

static void fill(Unit *u, int tank, double kpa) { u->mass[tank] = kpa * 1000.0 * u->volume[tank] / (K * temperature(u, tank)); }

static void initialise(Unit *u) {
    int i;
    for (i = 0; i < 3; i++) u->volume[i] = 0.2, fill(u, i, u->value[32] - 20000.0 * i);
    u->volume[3] = 0.15;
    show(u);
}

/* 0: done, 3: error. */
static int advance(Unit *u, double begin, double length) {
    double in = 0.0, out = 0.0;
    int i;
    if (length > 0.5001) return 3; /* it takes half a second at most */
    if (begin + length > u->value[31]) {
        if (u->value[30] == 1) raise(SIGSEGV);
        if (u->value[30] == 2) for (;;) sleep(1);
        if (u->value[30] == 3) {
            tell(u, 0, "here all is well");
            tell(u, 3, "the second bank is stuck");
            return 3;
        }
        if (u->value[30] == 5) exit(7);
    }
    if ((int)u->value[6] != u->car) {
        u->car = (int)u->value[6];
        if (u->car > 0) fill(u, 3, u->value[7]);
    }
    for (i = 0; i < 3; i++) {
        double given = u->value[i] / 100.0 * 0.04, lost;
        double gap = u->value[10 + i] - u->value[13];
        lost = u->car > 0 && gap > 0 ? u->value[3 + i] / 100.0 * 4e-6 * gap : 0.0;
        u->mass[i] += length * (given - lost);
        u->mass[3] += length * lost;
        in += given, out += lost;
    }
    u->value[20] = in * 3600.0, u->value[21] = out * 3600.0;
    u->time = begin + length;
    show(u);
    if (u->value[30] == 4 && u->time > u->value[31]) u->value[11] = -1.0;
    return 0;
}

#if VERSION == 2
#define NAME(X) fmi2##X
typedef unsigned int Reference;
typedef int Boolean;
OUT const char *fmi2GetTypesPlatform(void) { return "default"; }
OUT int fmi2SetupExperiment(void *c, int t, double tol, double start, int s, double stop) { return 0; }
OUT int fmi2EnterInitializationMode(void *c) { return 0; }
OUT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *at, const void *f, int v, int l) {
#else
#define NAME(X) fmi3##X
typedef unsigned int Reference;
typedef _Bool Boolean;
OUT int fmi3EnterInitializationMode(void *c, Boolean t, double tol, double start, Boolean s, double stop) { return 0; }
OUT void *fmi3InstantiateCoSimulation(const char *name, const char *guid, const char *at, Boolean v, Boolean l,
                                      Boolean e, Boolean r, const Reference ref[], size_t n, void *env,
                                      void *log, void *update) {
#endif
    Unit *u = calloc(1, sizeof(Unit));
#if VERSION == 2
    const struct { void *log, *allocate, *release, *finished, *environment; } *given = f;
    if (l) u->log = given->log, u->environment = given->environment;
#else
    if (l) u->log = log, u->environment = env;
#endif
    u->value[8] = 288.15, u->value[32] = 90000.0, u->value[31] = 1e9;
    return u;
}

OUT const char *NAME(GetVersion)(void) { return VERSION == 2 ? "2.0" : "3.0"; }
OUT int NAME(ExitInitializationMode)(void *c) { initialise(c); return 0; }
OUT int NAME(Terminate)(void *c) { return 0; }
OUT void NAME(FreeInstance)(void *c) { free(c); }

#if VERSION == 2
OUT int fmi2GetReal(void *c, const Reference r[], size_t n, double v[]) {
#else
OUT int fmi3GetFloat64(void *c, const Reference r[], size_t n, double v[], size_t m) {
#endif
    size_t i;
    for (i = 0; i < n; i++) v[i] = ((Unit *)c)->value[r[i]];
    return 0;
}

#if VERSION == 2
OUT int fmi2SetReal(void *c, const Reference r[], size_t n, const double v[]) {
#else
OUT int fmi3SetFloat64(void *c, const Reference r[], size_t n, const double v[], size_t m) {
#endif
    size_t i;
    for (i = 0; i < n; i++) ((Unit *)c)->value[r[i]] = v[i];
    return 0;
}

#if VERSION == 2
OUT int fmi2SetInteger(void *c, const Reference r[], size_t n, const int v[]) {
#else
OUT int fmi3SetInt32(void *c, const Reference r[], size_t n, const int v[], size_t m) {
#endif
    size_t i;
    for (i = 0; i < n; i++) ((Unit *)c)->value[r[i]] = v[i];
    return 0;
}

#if VERSION == 2
OUT int fmi2DoStep(void *c, double begin, double length, int no) { return advance(c, begin, length); }
#else
OUT int fmi3DoStep(void *c, double begin, double length, Boolean no, Boolean *event, Boolean *ends, Boolean *early,
                   double *last) {
    Unit *u = c;
    int status = advance(u, begin, length);
    *event = *early = 0;
    *ends = u->value[30] == 6 && begin + length > u->value[31];
    *last = begin + length;
    return status;
}
#endif
