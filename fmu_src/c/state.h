/* Saved states of an instance, and their bytes. */
#ifndef VDFMU_STATE_H
#define VDFMU_STATE_H

#include "instance.h"

size_t core_size(void); /* of a Core with its values */

/* `*state` NULL: a new state; otherwise one of this instance, which is written over. */
Status state_get(Instance *I, void **state);
Status state_set(Instance *I, const void *state);
Status state_free(Instance *I, void **state);
void states_free(Instance *I);

Status state_size(const Instance *I, const void *state, size_t *size);
Status state_to_bytes(const Instance *I, const void *state, unsigned char *bytes, size_t size);
Status state_from_bytes(Instance *I, const unsigned char *bytes, size_t size, void **state);

#endif
