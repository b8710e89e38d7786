/* To be preloaded. A C++ block of 128 bytes, the size of what holds the interpreter of a library of pythonfmu, gets a page
   of its own, which is closed when the block is freed. An access after that ends the process at its place by SIGSEGV.
   Without the guard it changes memory that may belong to somebody else by then. */
#define _DEFAULT_SOURCE
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/mman.h>

enum { SIZE = 128, PAGE = 4096, MOST = 4096 };
static void *_Atomic pages[MOST];
static atomic_int count;

static int guarded(void *block) {
    int n = atomic_load(&count);
    for (int i = 0; i < n && i < MOST; i++)
        if (pages[i] == block) return 1;
    return 0;
}

void *_Znwm(size_t size) { /* operator new */
    int i = size == SIZE ? atomic_fetch_add(&count, 1) : MOST;
    if (i >= MOST) return malloc(size);
    void *page = mmap(NULL, PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED) abort();
    return pages[i] = page;
}

void _ZdlPv(void *block) { /* operator delete */
    if (!block || !guarded(block)) free(block);
    else if (mprotect(block, PAGE, PROT_NONE) != 0) abort();
}
void _ZdlPvm(void *block, size_t size) { (void)size, _ZdlPv(block); }
