/* The mark of functions that the engine is to find. */
#ifndef VDFMU_SHOWN_H
#define VDFMU_SHOWN_H

#ifdef _WIN32
#define SHOWN __declspec(dllexport)
#else
#define SHOWN __attribute__((visibility("default")))
#endif

#endif
