#ifndef LOOKUP_PLACE
#define LOOKUP_PLACE
#ifdef SCALARS
#define LOOKUP_LANES 1
#define LANE(x, i) (x)
#else /* a double is a vector: fmu_src/batch/lanes.h */
#define LOOKUP_LANES LANES
#define LANE(x, i) (x)[i]
#endif

/* the last k below m with edges[k] <= x, or 0 */
static int lookup_place(const scalar *edges, int m, scalar x)
{
    int low = 0;
    for (int high = m; high - low > 1;) {
        const int middle = (low + high) / 2;
        if (x >= edges[middle])
            low = middle;
        else
            high = middle;
    }
    return low;
}
#endif
