/* A builtin f(t, x) of Python, made without Python's headers: the value of a number, and the address of the data of
   an array, are the first that follow the head of an object. Returns the array of the derivatives. */
typedef struct Object Object;
typedef struct {
    void (*run)(double *memory, double t);
    double *memory, *x;
    size_t size; /* of x, in bytes */
    Object *x_dot;
    void (*hold)(Object *object);
} Rate;
#define FIRST(object, type) (*(type *)((char *)(object) + OBJECT_HEAD))

static Object *rate_of(Object *self, Object *const *arguments, ptrdiff_t count)
{
    const Rate *rate = FIRST(self, const Rate *);
    (void)count;
    memcpy(rate->x, FIRST(arguments[1], const double *), rate->size);
    rate->run(rate->memory, FIRST(arguments[0], double));
    rate->hold(rate->x_dot);
    return rate->x_dot;
}

/* PyMethodDef, with METH_FASTCALL */
SHOWN struct {
    const char *name;
    Object *(*call)(Object *, Object *const *, ptrdiff_t);
    int flags;
    const char *text;
} rate_method = {"rate", rate_of, 0x80, NULL};
