#include "message.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define POSITIVE 1e-12 /* smallest value of what must be positive: FMI has no strict bounds */

void text_add_list(Text *t, const char *format, va_list arguments)
{
    va_list again;
    va_copy(again, arguments);
    const int needed = vsnprintf(NULL, 0, format, again);
    va_end(again);
    if (needed <= 0)
        return;
    const size_t size = t->length + (size_t)needed + 1;
    if (size > t->capacity) {
        const size_t capacity = 2 * size;
        char *text = realloc(t->text, capacity);
        if (!text)
            return;
        t->text = text;
        t->capacity = capacity;
    }
    vsnprintf(t->text + t->length, t->capacity - t->length, format, arguments);
    t->length += (size_t)needed;
}

void text_add(Text *t, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    text_add_list(t, format, arguments);
    va_end(arguments);
}

void text_free(Text *t)
{
    free(t->text);
    *t = (Text){0};
}

static void point_for_comma(char *text) /* where the locale of the process has a decimal comma */
{
    char *comma = strchr(text, ',');
    if (comma)
        *comma = '.';
}

const char *number(char text[NUMBER_SIZE], int digits, double value)
{
    if (isnan(value))
        return strcpy(text, "nan");
    if (isinf(value))
        return strcpy(text, value > 0.0 ? "inf" : "-inf");
    if (digits > 0) {
        snprintf(text, NUMBER_SIZE, "%.*g", digits, value);
        point_for_comma(text);
        return text;
    }
    for (int d = 15; d <= 17; d++) {
        snprintf(text, NUMBER_SIZE, "%.*g", d, value);
        if (strtod(text, NULL) == value)
            break;
    }
    point_for_comma(text);
    if (!strpbrk(text, ".e"))
        strcat(text, ".0");
    return text;
}

static bool has_measure(const Variable *v)
{
    return v->measure[0] && strcmp(v->measure, "1") != 0;
}

const char *measure_space(const Variable *v)
{
    return has_measure(v) ? " " : "";
}

const char *measure_name(const Variable *v)
{
    return has_measure(v) ? v->measure : "";
}

void text_add_problem(Text *t, const Variable *v, double value)
{
    const char *space = measure_space(v), *measure = measure_name(v);
    text_add(t, "expected ");
    if (v->n_choices) {
        for (size_t i = 0; i < v->n_choices; i++)
            text_add(t, "%s%u (%s)", i ? " or " : "", (unsigned)i, v->choices[i]);
    } else if (!isfinite(value)) {
        text_add(t, "a finite number");
    } else if (value < v->min) {
        if (v->min == POSITIVE && value <= 0.0)
            text_add(t, "a number above 0");
        else
            text_add(t, "at least %s%s%s", G6(v->min), space, measure);
    } else {
        text_add(t, "at most %s%s%s", G6(v->max), space, measure);
    }
    text_add(t, ", got %s%s%s", G9(value), space, measure);
}
