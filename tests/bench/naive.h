/* The reference loop: computes the force from given tensors, edge by edge, independent of the library. Nine numbers
 * and two indices per edge. */
#ifndef TM_BENCH_NAIVE_H
#define TM_BENCH_NAIVE_H

typedef struct naive_edge {
    double K[9];
    int a, b;
} naive_edge;
typedef struct naive_edge_single {
    float K[9];
    int a, b;
} naive_edge_single;

/* Computes force = -K u from blocks [9*vertices] of vertices and K_ab of each edge, whose transpose is K_ba.
 * Computes in double; `single`: the edges' blocks are stored in single. */
typedef void naive_double(int vertices, const double *block, int edges, const naive_edge *edge,
                          const double *restrict u, double *restrict force);
typedef void naive_single(int vertices, const double *block, int edges, const naive_edge_single *edge,
                          const double *restrict u, double *restrict force);
/* Compiled with the flags of any other file and, `wide`, for processors with AVX2 and FMA: module.mk. */
naive_double naive_plain_double, naive_wide_double;
naive_single naive_plain_single, naive_wide_single;

#endif
