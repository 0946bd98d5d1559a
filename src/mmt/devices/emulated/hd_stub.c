/* A library with the interface of OpenHaptics HD, for a machine without a device.
 *
 * It keeps the rules that a driver must keep (frames, errors that pop newest first, one
 * device a name) and moves two tips, each a damped mass that a motor, a virtual wall and a
 * hand's spring push. Functions that begin with mmt_stub are the emulator's own.
 */
#include <pthread.h>
#include <string.h>
#include <time.h>
#include <math.h>

typedef unsigned int Enum;
typedef struct { Enum code; int internal; Enum device; } ErrorInfo;
typedef Enum (*Callback)(void *);

enum { DEVICES = 2, JOBS = 8, ERRORS = 32, SUBSTEPS = 10 };
enum { ABSENT, COMM_LOST, WARM, FAULT, STALLED, UNLICENSED, FAULTS };

typedef struct {
    int open, framed, held, walled;
    char name[64];
    double position[3], velocity[3], motor[3], asked[3], hand[3];
    double hand_n_mm, wall_mm, wall_n_mm;
    int output, clamping;
} Device;

typedef struct { Callback call; void *data; unsigned long id; int once, done; } Job;

static pthread_mutex_t state = PTHREAD_MUTEX_INITIALIZER;   /* held for moments only */
static pthread_mutex_t tick = PTHREAD_MUTEX_INITIALIZER;    /* held while callbacks run */
static pthread_cond_t ticked = PTHREAD_COND_INITIALIZER;
static pthread_t thread;
static int running;
static Device devices[DEVICES];
static Job jobs[JOBS];
static unsigned long next_id = 0x100000001UL;   /* a handle that 32 bits cannot hold */
static unsigned long ticks;
static ErrorInfo errors[ERRORS];
static int error_count;
static int faults[FAULTS];
static double max_force_n = 8.5, max_stiffness_n_mm = 3.5;
static int styles = 2;
static Enum calibration = 0x5000;
static __thread Enum current = 0;
static const double MASS_KG = 0.075, DAMPING_N_S_M = 0.5;

static void push(Enum code)
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

const char *hdGetErrorString(Enum code) { return code ? "emulated error" : "no error"; }

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
    case 0x2503: return "mmt";
    case 0x2504: return "EMULATED1";
    }
    push(0x0100);
    return NULL;
}

void hdGetIntegerv(Enum what, int *values)
{
    if (what == 0x2555) values[0] = styles;
    else if (what == 0x2600) values[0] = 1000;
    else push(0x0100);
}

void hdGetDoublev(Enum what, double *values)
{
    Device *device = opened(current);
    const double *from = NULL;
    if (!device) return;
    switch (what) {
    case 0x2602: values[0] = max_stiffness_n_mm; return;
    case 0x2603: values[0] = max_force_n; return;
    case 0x2604: values[0] = max_force_n / 6; return;
    case 0x2050: from = device->position; break;
    case 0x2051: from = device->velocity; break;
    case 0x2700: from = device->asked; break;
    }
    if (!from) { push(0x0100); return; }
    pthread_mutex_lock(&state);
    memcpy(values, from, 3 * sizeof(double));
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
    device->framed = 1;
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
    if (style == 1 || calibration == 0x5001) calibration = 0x5000;
}

/* --- the tips */

static void move(Device *device)
{
    const double step_s = 1e-3 / SUBSTEPS;
    for (int n = 0; n < SUBSTEPS; n++) {
        for (int i = 0; i < 3; i++) {
            double velocity = 1e-3 * device->velocity[i];
            double force = device->motor[i] - DAMPING_N_S_M * velocity;
            if (device->held)
                force += device->hand_n_mm * (device->hand[i] - device->position[i]) - 2 * velocity;
            if (device->walled && i == 1 && device->position[1] < device->wall_mm)
                force += device->wall_n_mm * (device->wall_mm - device->position[1]) - velocity;
            device->velocity[i] += 1e3 * force / MASS_KG * step_s;
            device->position[i] += device->velocity[i] * step_s;
        }
    }
}

/* --- the scheduler */

static void run_jobs(void)
{
    for (int i = 0; i < JOBS; i++) {
        if (!jobs[i].call || jobs[i].done) continue;
        if (jobs[i].call(jobs[i].data) == 0 || jobs[i].once) {
            jobs[i].done = 1;
            if (!jobs[i].once) jobs[i].call = NULL;
        }
    }
    pthread_cond_broadcast(&ticked);
}

static void *loop(void *unused)
{
    struct timespec due, now;
    (void)unused;
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (__atomic_load_n(&running, __ATOMIC_ACQUIRE)) {
        due.tv_nsec += 1000000;
        if (due.tv_nsec >= 1000000000) { due.tv_nsec -= 1000000000; due.tv_sec++; }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (now.tv_sec - due.tv_sec > 1) due = now;
        if (faults[STALLED]) continue;
        pthread_mutex_lock(&state);
        ticks++;
        if (!faults[COMM_LOST])
            for (int i = 0; i < DEVICES; i++) move(&devices[i]);
        pthread_mutex_unlock(&state);
        pthread_mutex_lock(&tick);
        run_jobs();
        pthread_mutex_unlock(&tick);
    }
    return NULL;
}

void hdStartScheduler(void)
{
    if (running) return;
    __atomic_store_n(&running, 1, __ATOMIC_RELEASE);
    if (pthread_create(&thread, NULL, loop, NULL)) { running = 0; push(0x0304); }
}

void hdStopScheduler(void)
{
    if (!running) return;
    __atomic_store_n(&running, 0, __ATOMIC_RELEASE);
    pthread_join(thread, NULL);
    pthread_mutex_lock(&state);
    for (int i = 0; i < DEVICES; i++) memset(devices[i].motor, 0, sizeof devices[i].motor);
    pthread_mutex_unlock(&state);
}

static Job *add(Callback call, void *data, int once)
{
    for (int i = 0; i < JOBS; i++)
        if (!jobs[i].call) {
            jobs[i] = (Job){call, data, next_id++, once, 0};
            return &jobs[i];
        }
    push(0x0501);
    return NULL;
}

unsigned long hdScheduleAsynchronous(Callback call, void *data, unsigned short priority)
{
    Job *job;
    (void)priority;
    pthread_mutex_lock(&tick);
    job = add(call, data, 0);
    pthread_mutex_unlock(&tick);
    return job ? job->id : 0xFFFFFFFF;
}

void hdScheduleSynchronous(Callback call, void *data, unsigned short priority)
{
    Job *job;
    (void)priority;
    if (!running) { call(data); return; }
    pthread_mutex_lock(&tick);
    job = add(call, data, 1);
    while (job && !job->done) pthread_cond_wait(&ticked, &tick);
    if (job) job->call = NULL;
    pthread_mutex_unlock(&tick);
}

void hdUnschedule(unsigned long id)
{
    int found = 0;
    pthread_mutex_lock(&tick);
    for (int i = 0; i < JOBS; i++)
        if (jobs[i].call && jobs[i].id == id) { jobs[i].call = NULL; found = 1; }
    pthread_mutex_unlock(&tick);
    if (!found) push(0x0101);
}

/* --- what the emulator sets and sees */

void mmt_stub_fault(Enum which, int on) { if (which < FAULTS) faults[which] = on; }

void mmt_stub_calibration(int offered, Enum status) { styles = offered; calibration = status; }

void mmt_stub_limits(double force_n, double stiffness_n_mm)
{
    max_force_n = force_n;
    max_stiffness_n_mm = stiffness_n_mm;
}

void mmt_stub_hand(Enum handle, int held, const double *position_mm, double stiffness_n_mm)
{
    if (handle >= DEVICES) return;
    pthread_mutex_lock(&state);
    devices[handle].held = held;
    memcpy(devices[handle].hand, position_mm, sizeof devices[handle].hand);
    devices[handle].hand_n_mm = stiffness_n_mm;
    pthread_mutex_unlock(&state);
}

void mmt_stub_wall(Enum handle, int on, double height_mm, double stiffness_n_mm)
{
    if (handle >= DEVICES) return;
    pthread_mutex_lock(&state);
    devices[handle].walled = on;
    devices[handle].wall_mm = height_mm;
    devices[handle].wall_n_mm = stiffness_n_mm;
    pthread_mutex_unlock(&state);
}

void mmt_stub_place(Enum handle, const double *position_mm)
{
    if (handle >= DEVICES) return;
    pthread_mutex_lock(&state);
    memcpy(devices[handle].position, position_mm, sizeof devices[handle].position);
    memset(devices[handle].velocity, 0, sizeof devices[handle].velocity);
    pthread_mutex_unlock(&state);
}

/* position (mm), velocity (mm/s) and motor force (N), three each */
void mmt_stub_look(Enum handle, double *values)
{
    if (handle >= DEVICES) return;
    pthread_mutex_lock(&state);
    memcpy(values, devices[handle].position, 3 * sizeof(double));
    memcpy(values + 3, devices[handle].velocity, 3 * sizeof(double));
    memcpy(values + 6, devices[handle].motor, 3 * sizeof(double));
    pthread_mutex_unlock(&state);
}

unsigned long mmt_stub_ticks(void) { return ticks; }

void mmt_stub_reset(void)
{
    pthread_mutex_lock(&state);
    memset(faults, 0, sizeof faults);
    for (int i = 0; i < DEVICES; i++) {
        int open = devices[i].open;
        char name[64];
        memcpy(name, devices[i].name, sizeof name);
        memset(&devices[i], 0, sizeof devices[i]);
        devices[i].open = open;
        memcpy(devices[i].name, name, sizeof name);
    }
    error_count = 0;
    max_force_n = 8.5;
    max_stiffness_n_mm = 3.5;
    styles = 2;
    calibration = 0x5000;
    pthread_mutex_unlock(&state);
}
