/* The loop itself, included by naive.c and naive_wide.c, which define NAIVE(name). The fastest of several variants
 * tried (without the sum in registers, loops over components, differences of displacements, separate arrays, no
 * `restrict`). */
static void multiply_blocks(int vertices, const double *block, const double *restrict u, double *restrict force) {
    for (int v = 0; v < vertices; v++) {
        const double *A = block + 9 * v, x = u[3 * v], y = u[3 * v + 1], z = u[3 * v + 2];
        force[3 * v] = -(A[0] * x + A[1] * y + A[2] * z);
        force[3 * v + 1] = -(A[3] * x + A[4] * y + A[5] * z);
        force[3 * v + 2] = -(A[6] * x + A[7] * y + A[8] * z);
    }
}

/* Processes consecutive edges with the same first end; the force on that end stays in registers. */
#define NAIVE_LOOP(real)                                                                                               \
    for (int e = 0; e < edges;) {                                                                                      \
        const int a = edge[e].a;                                                                                       \
        const double x = u[3 * a], y = u[3 * a + 1], z = u[3 * a + 2];                                                 \
        double fx = 0, fy = 0, fz = 0;                                                                                 \
        for (; e < edges && edge[e].a == a; e++) {                                                                     \
            const real *K = edge[e].K;                                                                                 \
            const int b = edge[e].b;                                                                                   \
            const double p = u[3 * b], q = u[3 * b + 1], r = u[3 * b + 2];                                             \
            fx += (double)K[0] * p + (double)K[1] * q + (double)K[2] * r;                                              \
            fy += (double)K[3] * p + (double)K[4] * q + (double)K[5] * r;                                              \
            fz += (double)K[6] * p + (double)K[7] * q + (double)K[8] * r;                                              \
            force[3 * b] -= (double)K[0] * x + (double)K[3] * y + (double)K[6] * z;                                    \
            force[3 * b + 1] -= (double)K[1] * x + (double)K[4] * y + (double)K[7] * z;                                \
            force[3 * b + 2] -= (double)K[2] * x + (double)K[5] * y + (double)K[8] * z;                                \
        }                                                                                                              \
        force[3 * a] -= fx, force[3 * a + 1] -= fy, force[3 * a + 2] -= fz;                                            \
    }

void NAIVE(double)(int vertices, const double *block, int edges, const naive_edge *edge, const double *restrict u,
                   double *restrict force) {
    multiply_blocks(vertices, block, u, force);
    NAIVE_LOOP(double)
}

void NAIVE(single)(int vertices, const double *block, int edges, const naive_edge_single *edge,
                   const double *restrict u, double *restrict force) {
    multiply_blocks(vertices, block, u, force);
    NAIVE_LOOP(float)
}
