/* The one header with `restrict`: the force loop's arrays never overlap, and only told so does the compiler keep sums in
 * registers. The plain C form is the reference; its order of sums is fixed (see force_kernel.h). */
#ifndef TM_KERNEL_H
#define TM_KERNEL_H

#include <stdint.h>

#define TM_RESTRICT restrict

/* force := -K u. `vertex` [9*vertex_count] and `edge` [9*edge_count] hold float or double tensors. */
typedef void (*tm_force_kernel)(int32_t vertex_count, const int32_t *TM_RESTRICT upper_begin,
                                const int32_t *TM_RESTRICT edge_vertex, const void *vertex, const void *edge,
                                const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);

void tm_force_plain_double(int32_t vertex_count, const int32_t *TM_RESTRICT upper_begin,
                           const int32_t *TM_RESTRICT edge_vertex, const void *vertex, const void *edge,
                           const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);
void tm_force_plain_single(int32_t vertex_count, const int32_t *TM_RESTRICT upper_begin,
                           const int32_t *TM_RESTRICT edge_vertex, const void *vertex, const void *edge,
                           const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);

#endif
