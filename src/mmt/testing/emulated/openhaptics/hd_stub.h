/* Declarations that the two halves of the emulated HD library share. */
#ifndef MMT_HD_STUB_H
#define MMT_HD_STUB_H

#include <pthread.h>

typedef unsigned int Enum;

enum { DEVICES = 2, ERRORS = 32 };
enum { ABSENT, COMM_LOST, WARM, FAULT, STALLED, UNLICENSED, GARBLED, STUCK, FAULTS };

typedef struct {
    int open, framed, held, walled;
    char name[64];
    double position[3], velocity[3], motor[3], asked[3], hand[3];
    double turned[9];    /* the columns of its rotation, minus those of none */
    double told[2][3];   /* the newest position and velocity that were given out */
    double hand_n_mm, wall_mm, wall_n_mm;
    int output, clamping;
    unsigned long framed_at;
} Device;

/* the interface's half */
extern Device devices[DEVICES];
extern pthread_mutex_t state;   /* held for moments only */
extern int faults[FAULTS], error_count, styles;
extern Enum calibration;
extern double max_force_n, max_stiffness_n_mm;
void push(Enum code);

/* the world's half: the tips, the scheduler, what the emulator sets and sees */
extern unsigned long ticks;
extern int running;

#endif
