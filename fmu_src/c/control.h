/* Numbers that control the internal step. */
#ifndef VDFMU_CONTROL_H
#define VDFMU_CONTROL_H

#define FIRST_STEP 1e-4    /* [s] internal step tried first after the start */
#define MINIMUM_STEP 1e-12 /* [s] 1e4 times rounding of a time of about 1 s */
#define MAXIMUM_STEPS 1000000 /* in one communication step; 10 s of the six-joint arm at 150 rad/s take 300,000 */

#define MAXIMUM_CHANGES 10000 /* of signs of events, in one communication step */
#define MAXIMUM_ROUNDS 100    /* of events at one time, each the cause of the next */
#define PARTS 8               /* of an internal step, at whose ends events are evaluated, on a cubic polynomial */

#define SAFETY 0.9
#define SHRINK 0.2
#define GROW 5.0

#endif
