/* A library with the interface of OpenHaptics HD, for a machine without a device.
 *
 * It enforces the rules for a driver: one frame a tick, a force within a frame, one
 * device a name, a current device for each thread, errors that pop newest first.
 */
#include "hd_stub.h"
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct { Enum code; int internal; Enum device; } ErrorInfo;

Device devices[DEVICES];
pthread_mutex_t state = PTHREAD_MUTEX_INITIALIZER;
int faults[FAULTS], error_count, styles = 2;
Enum calibration = 0x5000;
double max_force_n = 8.5, max_stiffness_n_mm = 3.5;
static ErrorInfo errors[ERRORS];
static __thread Enum current = 0;

void push(Enum code)
{
    pthread_mutex_lock(&state);
    if (error_count == ERRORS) {
        memmove(errors, errors + 1, sizeof(ErrorInfo) * (ERRORS - 1));
        error_count--;
    }
    errors[error_count++] = (ErrorInfo){code, -1, current};
    pthread_mutex_unlock(&state);
}

static Device *opened(Enum handle)
{
    if (handle < DEVICES && devices[handle].open) return &devices[handle];
    push(0x0104);
    return NULL;
}

/* --- errors */

ErrorInfo hdGetError(void)
{
    ErrorInfo none = {0, 0, 0xFFFFFFFF};
    pthread_mutex_lock(&state);
    if (error_count) none = errors[--error_count];
    pthread_mutex_unlock(&state);
    return none;
}

/* --- devices */

Enum hdInitDevice(const char *name)
{
    const char *wanted = name ? name : "Default Device";
    int free_one = -1;
    if (faults[UNLICENSED]) { push(0x0600); return 0xFFFFFFFF; }
    if (faults[ABSENT]) { push(0x0300); return 0xFFFFFFFF; }
    if (faults[COMM_LOST]) { push(0x0302); return 0xFFFFFFFF; }
    for (int i = DEVICES - 1; i >= 0; i--) {
        if (devices[i].open && strcmp(devices[i].name, wanted) == 0) {
            push(0x0301);
            return 0xFFFFFFFF;
        }
        if (!devices[i].open) free_one = i;
    }
    if (free_one < 0) { push(0x0300); return 0xFFFFFFFF; }
    pthread_mutex_lock(&state);
    devices[free_one].open = 1;
    devices[free_one].framed = devices[free_one].output = devices[free_one].clamping = 0;
    strncpy(devices[free_one].name, wanted, sizeof devices[free_one].name - 1);
    pthread_mutex_unlock(&state);
    current = (Enum)free_one;
    return current;
}

void hdDisableDevice(Enum handle)
{
    Device *device = opened(handle);
    if (!device) return;
    pthread_mutex_lock(&state);
    device->open = 0;
    memset(device->motor, 0, sizeof device->motor);
    pthread_mutex_unlock(&state);
}

void hdMakeCurrentDevice(Enum handle) { if (opened(handle)) current = handle; }

static void enable(Enum what, int on)
{
    Device *device = opened(current);
    if (!device) return;
    if (what == 0x4000) device->output = on;
    else if (what == 0x4001) device->clamping = on;
    else if (what < 0x4002 || what > 0x4004) push(0x0100);
}

void hdEnable(Enum what) { enable(what, 1); }
void hdDisable(Enum what) { enable(what, 0); }

const char *hdGetString(Enum what)
{
    switch (what) {
    case 0x2501: return "Emulated HD device";
    case 0x2504: return "EMULATED1";
    }
    push(0x0100);
    return NULL;
}

void hdGetIntegerv(Enum what, int *values)
{
    if (what == 0x2555) values[0] = styles;
    else push(0x0100);
}

/* Spoil a measurement as a bad line does: repeat the old one, or now and then flip a bit. */
static void spoil(double told[3], double *values)
{
    if (faults[STUCK]) memcpy(values, told, 3 * sizeof(double));
    else memcpy(told, values, 3 * sizeof(double));
    if (faults[GARBLED] && ticks % 50 < 2) {
        uint64_t bits;
        memcpy(&bits, &values[ticks % 3], sizeof bits);
        bits ^= (uint64_t)1 << (ticks % 50 ? 62 : 61);
        memcpy(&values[ticks % 3], &bits, sizeof bits);
    }
    if (faults[GARBLED] && ticks % 50 == 2) values[0] = NAN;
}

static void place_and_turn(const Device *device, double values[16])
{
    memset(values, 0, 16 * sizeof(double));
    for (int i = 0; i < 3; i++) {
        memcpy(values + 4 * i, device->turned + 3 * i, 3 * sizeof(double));
        values[5 * i] += 1;
    }
    memcpy(values + 12, device->position, 3 * sizeof(double));
    values[15] = 1;
}

void hdGetDoublev(Enum what, double *values)
{
    Device *device = opened(current);
    const double *from = NULL;
    if (!device) return;
    switch (what) {
    case 0x2602: values[0] = max_stiffness_n_mm; return;
    case 0x2603: values[0] = max_force_n; return;
    case 0x2050: from = device->position; break;
    case 0x2051: from = device->velocity; break;
    case 0x2700: from = device->asked; break;
    }
    if (!from && what != 0x2052) { push(0x0100); return; }
    pthread_mutex_lock(&state);
    if (!from) place_and_turn(device, values);
    else memcpy(values, from, 3 * sizeof(double));
    if (from && what != 0x2700) spoil(device->told[what == 0x2051], values);
    pthread_mutex_unlock(&state);
}

void hdSetDoublev(Enum what, const double *values)
{
    Device *device = opened(current);
    if (!device) return;
    if (what != 0x2700) { push(0x0100); return; }
    if (!device->framed) { push(0x0102); return; }
    memcpy(device->asked, values, sizeof device->asked);
}

/* --- frames */

void hdBeginFrame(Enum handle)
{
    Device *device = opened(handle);
    if (!device) return;
    current = handle;
    if (device->framed) { push(0x0400); return; }
    if (running && device->framed_at == ticks) push(0x0402);
    device->framed = 1;
    device->framed_at = ticks;
    memset(device->asked, 0, sizeof device->asked);
}

static Enum limited(const Device *device, double force[3])
{
    double size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
    double share = 1;
    Enum problem = 0;
    if (faults[WARM]) { share = 0; problem = 0x0200; }
    else if (!isfinite(size)) { memset(force, 0, 3 * sizeof(double)); return 0x0204; }
    else if (size > max_force_n * (1 + 1e-9)) {
        share = device->clamping ? max_force_n / size : 0;
        problem = device->clamping ? 0 : 0x0201;
    }
    for (int i = 0; i < 3; i++) force[i] = device->output ? share * force[i] : 0;
    return problem;
}

void hdEndFrame(Enum handle)
{
    Device *device = opened(handle);
    double force[3];
    Enum problem;
    if (!device) return;
    if (!device->framed) { push(0x0401); return; }
    device->framed = 0;
    memcpy(force, device->asked, sizeof force);
    problem = limited(device, force);
    if (problem) push(problem);
    if (faults[FAULT]) push(0x0300);
    if (faults[COMM_LOST]) push(0x0302);
    if (faults[FAULT] || faults[COMM_LOST]) memset(force, 0, sizeof force);
    pthread_mutex_lock(&state);
    memcpy(device->motor, force, sizeof force);
    pthread_mutex_unlock(&state);
}

/* --- calibration */

Enum hdCheckCalibration(void) { return calibration; }

void hdUpdateCalibration(Enum style)
{
    if (!(style & (Enum)styles)) { push(0x0103); return; }
    if (style != 1 && calibration != 0x5001) return;
    calibration = 0x5000;
    pthread_mutex_lock(&state);
    if (opened(current)) opened(current)->position[0] += 150;   /* its zero is another one now */
    pthread_mutex_unlock(&state);
}
