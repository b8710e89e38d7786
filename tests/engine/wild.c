/* The strict unit, which does what no unit may at the time of its parameter `at`, in the way of its parameter `way`.
   Both have the start values that the GUID tells. With BEATS in the environment an instance forks a process whose heart
   beats into the file of that name, every 20 ms; with WORDS a step prints it. */
#define _DEFAULT_SOURCE
#include <unistd.h>
#define fmi2DoStep strict_step
#define fmi2Terminate strict_terminate
#define fmi2FreeInstance strict_free
#define fmi2SetReal strict_set
#define fmi2Instantiate strict_make
#define fmi2ExitInitializationMode strict_exit
#include "strict.c"
#undef fmi2DoStep
#undef fmi2Terminate
#undef fmi2FreeInstance
#undef fmi2SetReal
#undef fmi2Instantiate
#undef fmi2ExitInitializationMode
enum { CRASH = 1, LEAVE, HANG, EAT, CRASH_FREE, ERROR_END, FATAL_END, STRANGE, NEGATIVE, ERROR_FREE, LEAVE_EARLY, HANG_END,
       STRANGE_END };
static double way, at;  /* each run has a library of its own */
static volatile int *nowhere;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    const char *beats = getenv("BEATS");
    if (beats && fork() == 0) for (;; usleep(20000)) {
        FILE *file = fopen(beats, "a");
        if (!file || fputc(1, file) == EOF || fclose(file) == EOF) exit(1);
    }
    return sscanf(guid, "{wild %lf %lf}", &way, &at) == 2
               ? strict_make(name, type, guid, place, call, visible, logging) : NULL;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference *r, size_t n, const fmi2Real *x) {
    for (size_t i = 0; i < n; i++)
        if (r[i] == 100) way = x[i];
        else if (r[i] == 101) at = x[i];
        else strict_set(c, r + i, 1, x + i);
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    if (way == LEAVE_EARLY) exit(3);
    return strict_exit(c);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean final) {
    if (getenv("WORDS")) printf("%s\n", getenv("WORDS")), fflush(stdout);
    if (t >= at) switch ((int)way) {
        case CRASH: *nowhere = 1; break;
        case LEAVE: exit(0);
        case HANG: for (;;) pause();  /* from outside it is as a loop, without its processor time */
        case EAT: for (;;) memset(malloc(1 << 20), 1, 1 << 20);
        case STRANGE: return 17;
        case NEGATIVE: return -1;
        }
    return strict_step(c, t, h, final);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    if (way == ERROR_END) return say(c, fmi2Error, "the brake does not close");
    if (way == FATAL_END) return fmi2Fatal;
    if (way == STRANGE_END) return 17;
    if (way == HANG_END) for (;;) pause();
    return strict_terminate(c);
}

void fmi2FreeInstance(fmi2Component c) {
    if (way == CRASH_FREE) *nowhere = 1;
    if (way == ERROR_FREE) say(c, fmi2Error, "the file is still open");
    strict_free(c);
}
