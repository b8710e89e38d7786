/* Plugin of qemu-user 7 and later: the instructions between one system call getppid and the next, sorted.
 *
 *     qemu-x86_64 -plugin count.so -d plugin -D COUNTS PROGRAM ..
 *
 * The arguments of the first call are where a library begins and ends. COUNTS: least, median and largest number, and how
 * many there are, of all instructions and, in a second line, of those of the library. Declared here is what it takes of
 * qemu-plugin.h.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

typedef uint64_t Id;
struct qemu_plugin_tb;
extern void qemu_plugin_register_vcpu_tb_trans_cb(Id id, void (*cb)(Id id, struct qemu_plugin_tb *tb));
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
extern uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *tb);
extern void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *tb, int add, void *ptr, uint64_t imm);
extern void qemu_plugin_register_vcpu_syscall_cb(Id id, void (*cb)(Id id, unsigned vcpu, int64_t num, uint64_t a1, uint64_t a2,
                                                 uint64_t a3, uint64_t a4, uint64_t a5, uint64_t a6, uint64_t a7, uint64_t a8));
extern void qemu_plugin_register_atexit_cb(Id id, void (*cb)(Id id, void *data), void *data);
extern void qemu_plugin_outs(const char *text);

#define GETPPID 110 /* of x86-64 */
#define ROOM 2000000

__attribute__((visibility("default"))) int qemu_plugin_version = 1;
static uint64_t begin, end;
static struct {
    uint64_t executed, before;
    uint32_t counts[ROOM];
} all, own;
static size_t n;

static void translated(Id id, struct qemu_plugin_tb *tb)
{
    (void)id;
    const uint64_t at = qemu_plugin_tb_vaddr(tb);
    qemu_plugin_register_vcpu_tb_exec_inline(tb, 0, &all.executed, qemu_plugin_tb_n_insns(tb));
    if (at >= begin && at < end)
        qemu_plugin_register_vcpu_tb_exec_inline(tb, 0, &own.executed, qemu_plugin_tb_n_insns(tb));
}

static void called(Id id, unsigned vcpu, int64_t num, uint64_t a1, uint64_t a2, uint64_t a3, uint64_t a4, uint64_t a5,
                   uint64_t a6, uint64_t a7, uint64_t a8)
{
    (void)id, (void)vcpu, (void)a3, (void)a4, (void)a5, (void)a6, (void)a7, (void)a8;
    if (num != GETPPID)
        return;
    if (!end) {
        begin = a1;
        end = a2;
    } else if (all.before && n < ROOM) {
        all.counts[n] = (uint32_t)(all.executed - all.before);
        own.counts[n++] = (uint32_t)(own.executed - own.before);
    }
    if (!a2) {
        all.before = all.executed;
        own.before = own.executed;
    }
}

static int order(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

static void tell(uint32_t counts[])
{
    char text[100];
    qsort(counts, n, sizeof *counts, order);
    snprintf(text, sizeof text, "%" PRIu32 " %" PRIu32 " %" PRIu32 " %zu\n", counts[0], counts[n / 2], counts[n ? n - 1 : 0], n);
    qemu_plugin_outs(text);
}

static void ended(Id id, void *data)
{
    (void)id, (void)data;
    tell(all.counts);
    tell(own.counts);
}

__attribute__((visibility("default"))) int qemu_plugin_install(Id id, const void *info, int argc, char **argv)
{
    (void)info, (void)argc, (void)argv;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_vcpu_syscall_cb(id, called);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
