/* The world of the emulated HD devices: two tips, each a damped mass that its motor, a virtual
 * wall and a hand's spring push; the scheduler that ticks; and what the emulator sets and sees.
 */
#include "hd_stub.h"
#include <string.h>
#include <time.h>

typedef Enum (*Callback)(void *);
typedef struct { Callback call; void *data; unsigned long id; } Job;

enum { JOBS = 8, SUBSTEPS = 10 };

unsigned long ticks;
int running;
static pthread_mutex_t tick = PTHREAD_MUTEX_INITIALIZER;   /* held while callbacks run */
static pthread_t thread;
static Job jobs[JOBS];
static long long own_ns;   /* processor time of the servo thread outside the callbacks */
static unsigned long next_id = 0x100000001UL;   /* a handle that 32 bits cannot hold */
static const double MASS_KG = 0.075, DAMPING_N_S_M = 0.5;

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
    for (int i = 0; i < JOBS; i++)
        if (jobs[i].call && jobs[i].call(jobs[i].data) == 0) jobs[i].call = NULL;
}

static long long processor_ns(void)
{
    struct timespec used;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
    return used.tv_sec * 1000000000LL + used.tv_nsec;
}

static void *loop(void *unused)
{
    struct timespec due, now;
    long long began_ns, returned_ns = processor_ns();
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
        began_ns = processor_ns();
        __atomic_add_fetch(&own_ns, began_ns - returned_ns, __ATOMIC_RELAXED);
        run_jobs();
        returned_ns = processor_ns();
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

unsigned long hdScheduleAsynchronous(Callback call, void *data, unsigned short priority)
{
    unsigned long id = 0xFFFFFFFF;
    (void)priority;
    pthread_mutex_lock(&tick);
    for (int i = 0; i < JOBS && id == 0xFFFFFFFF; i++)
        if (!jobs[i].call) {
            id = next_id++;
            jobs[i] = (Job){call, data, id};
        }
    pthread_mutex_unlock(&tick);
    if (id == 0xFFFFFFFF) push(0x0501);
    return id;
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

void mmt_stub_turn(Enum handle, const double *columns)
{
    if (handle >= DEVICES) return;
    pthread_mutex_lock(&state);
    memcpy(devices[handle].turned, columns, sizeof devices[handle].turned);
    for (int i = 0; i < 3; i++) devices[handle].turned[4 * i] -= 1;
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

long long mmt_stub_own_ns(void) { return __atomic_load_n(&own_ns, __ATOMIC_RELAXED); }

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
