/* Known faults, one of which tests/stability/test_planted.py switches in at a time to see the named tests turn red.
 * Always 0 in a product. */
#ifndef TM_PLANT_H
#define TM_PLANT_H

#ifndef PLANT_EQ12 /* the paper's eq. 12 weighs isotropy double */
#define PLANT_EQ12 0
#endif
#ifndef PLANT_GAMMA /* the paper's eq. 19 and 21: a positive gamma feeds energy in */
#define PLANT_GAMMA 0
#endif
#ifndef PLANT_REMOVAL /* one block's sign is wrong when a tetrahedron is removed */
#define PLANT_REMOVAL 0
#endif
#ifndef PLANT_H_MIN /* h_min / c taken for the critical step */
#define PLANT_H_MIN 0
#endif

#endif
