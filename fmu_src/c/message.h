/* Text of messages: a string that grows, and numbers that read the same on every platform. */
#ifndef VDFMU_MESSAGE_H
#define VDFMU_MESSAGE_H

#include <stdarg.h>
#include <stddef.h>

#include "unit.h"

/* Starts as {0}. It is truncated if allocation fails. */
typedef struct {
    char *text; /* NULL as long as it is empty */
    size_t length, capacity;
} Text;

void text_add(Text *t, const char *format, ...);
void text_add_list(Text *t, const char *format, va_list arguments);
void text_free(Text *t);

#define NUMBER_SIZE 40

/* Write a number with `digits` significant digits, as %g does; 0 digits: as few as give the same number back, and a point. */
const char *number(char text[NUMBER_SIZE], int digits, double value);

#define G6(value) number((char[NUMBER_SIZE]){0}, 6, value)
#define G9(value) number((char[NUMBER_SIZE]){0}, 9, value)
#define EXACT(value) number((char[NUMBER_SIZE]){0}, 0, value)

/* Unit of a variable with a space before it; nothing if it has none. */
const char *measure_space(const Variable *v);
const char *measure_name(const Variable *v);

/* "expected .., got .." for a value that a variable cannot have. */
void text_add_problem(Text *t, const Variable *v, double value);

#endif
