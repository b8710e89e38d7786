/* Steps a unit of FMI 2.0 where the kernel allows no system call but read, write and exit, and no allocation is made.
 *
 *     realtime LIBRARY GUID INPUTS OUTPUTS SOLVER STEPS
 *
 * INPUTS, OUTPUTS: their value references, from A to B without B: "0:12". SOLVER: value reference of an integer and its
 * value, "64:4". A system call ends the process by SIGKILL, an allocation or a failed step with exit code 1; As a
 * seventh argument "allocate" makes an allocation and "call" a system call, which must be found; "count" allows all, and
 * calls getppid after each step, for count.c.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fmi2Functions.h>
#include <link.h>
#include <linux/seccomp.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

static void leave(int code, const char *text)
{
    if (write(1, text, strlen(text)) < 0)
        code = 2;
    syscall(SYS_exit, code); /* exit_group is not allowed */
}

/* ---------------------------------------------------------------- the allocator of the process, which the library uses */

static int stepping;
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *room, size_t size);
extern void __libc_free(void *room);

static void count(void)
{
    if (stepping)
        leave(1, "an allocation\n");
}

void *calloc(size_t n, size_t size)
{
    count();
    return __libc_calloc(n, size);
}

void *malloc(size_t size)
{
    return calloc(1, size);
}

void *realloc(void *room, size_t size)
{
    count();
    return __libc_realloc(room, size);
}

void free(void *room)
{
    count();
    __libc_free(room);
}

/* ---------------------------------------------------------------- the unit */

#define ROOM 512
static void *library;

static void *symbol(const char *name)
{
    void *found = dlsym(library, name);
    if (!found)
        leave(1, dlerror());
    return found;
}

#define LOOK_UP(name) fmi2##name##TYPE *name = (fmi2##name##TYPE *)(uintptr_t)symbol("fmi2" #name)

static void receive(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)environment, (void)name, (void)category;
    if (status != fmi2OK)
        leave(1, text);
}

/* Tell count.c where the library is, whose own instructions it counts by themselves. */
static int tell(struct dl_phdr_info *info, size_t size, void *place)
{
    (void)size;
    if (info->dlpi_addr != ((struct link_map *)place)->l_addr)
        return 0;
    uintptr_t end = 0;
    for (int i = 0; i < info->dlpi_phnum; i++)
        if (info->dlpi_phdr[i].p_type == PT_LOAD)
            end = info->dlpi_phdr[i].p_vaddr + info->dlpi_phdr[i].p_memsz;
    syscall(SYS_getppid, info->dlpi_addr, info->dlpi_addr + end);
    return 1;
}

static size_t range(const char *text, fmi2ValueReference refs[])
{
    char *rest;
    size_t n = 0;
    const unsigned first = (unsigned)strtoul(text, &rest, 10), end = (unsigned)strtoul(rest + 1, NULL, 10);
    for (unsigned ref = first; ref < end && n < ROOM; ref++)
        refs[n++] = ref;
    return n;
}

int main(int n_arguments, char *arguments[])
{
    if (n_arguments < 7 || !(library = dlopen(arguments[1], RTLD_NOW)))
        leave(1, "expected a library and its arguments\n");
    fmi2ValueReference in[ROOM], out[ROOM], solver = (fmi2ValueReference)strtoul(arguments[5], &arguments[5], 10);
    const size_t n_in = range(arguments[3], in), n_out = range(arguments[4], out);
    const fmi2Integer kind = atoi(arguments[5] + 1);
    const long steps = atol(arguments[6]);
    const char *fault = n_arguments > 7 ? arguments[7] : "";
    const int counting = strcmp(fault, "count") == 0;
    if (counting)
        dl_iterate_phdr(tell, library); /* glibc's handle is the link map */
    LOOK_UP(Instantiate);
    LOOK_UP(SetupExperiment);
    LOOK_UP(EnterInitializationMode);
    LOOK_UP(ExitInitializationMode);
    LOOK_UP(SetInteger);
    LOOK_UP(SetReal);
    LOOK_UP(GetReal);
    LOOK_UP(DoStep);
    static const fmi2CallbackFunctions callbacks = {receive, calloc, free, NULL, NULL};
    fmi2Component c = Instantiate("unit", fmi2CoSimulation, arguments[2], NULL, &callbacks, 0, 0);
    if (!c || SetInteger(c, &solver, 1, &kind) || SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) || EnterInitializationMode(c) ||
        ExitInitializationMode(c))
        leave(1, "expected an initialized unit\n");

    double u[ROOM], y[ROOM];
    stepping = 1;
    if (!counting && prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT))
        leave(2, "no seccomp\n");
    for (long k = 0; k < steps; k++) {
        for (size_t i = 0; i < n_in; i++)
            u[i] = ((double)((k / 5 * 7 + 3 * (long)i) % 17) - 8.0) / 256.0;
        if (SetReal(c, in, n_in, u) || DoStep(c, (double)k * 0x1p-10, 0x1p-10, fmi2True) || GetReal(c, out, n_out, y))
            leave(1, "expected a step\n");
        if (counting)
            syscall(SYS_getppid, 0, 0);
    }
    if (strcmp(fault, "allocate") == 0)
        *(void *volatile *)u = malloc(1);
    if (strcmp(fault, "call") == 0)
        syscall(SYS_getppid, 0, 0);
    if (counting)
        exit(0); /* the plugin writes what it has counted */
    leave(0, "done\n");
}
