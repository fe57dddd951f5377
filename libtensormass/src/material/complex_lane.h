/* One lane of complex numbers, for derivatives by the complex step: f'(x) = Im f(x + i h)/h. It takes no difference and
 * is exact to rounding. Comparisons use real parts. Defines those operations of simd_vector.h that laws use. */

#define V8 double _Complex
#define M8 int64_t
#define INSIDE static inline
#define REAL(x) (x)

INSIDE void TM_NAME(choose)(V8 *to, const M8 *mask, const V8 *yes, const V8 *no) { *to = *mask ? *yes : *no; }
INSIDE bool TM_NAME(any)(const M8 *mask) { return *mask != 0; }
INSIDE void TM_NAME(root)(V8 *x) { *x = csqrt(*x); }
INSIDE M8 TM_NAME(exceeds)(const V8 *x, const V8 *most) { return creal(*x) > creal(*most) ? -1 : 0; }
INSIDE void TM_NAME(exponential)(const V8 *x, V8 *y) { *y = cexp(*x); }

#include "material/cofactor.h"
