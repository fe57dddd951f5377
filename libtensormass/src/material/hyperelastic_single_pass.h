/* The pass of nonlinear laws in single precision; a part of hyperelastic_single.c. */

#include "material/simd_vector.h"

#include "material/single_difference.h"

#include "material/tet_batch_kernel.h"

#include "material/hyperelastic_kernel.h"

#include "material/hyperelastic_batch.h"

#define TM_BATCHES tm_single_law
#include "material/hyperelastic_force.h"
#undef V8
#undef M8
#undef INSIDE
#undef REAL
