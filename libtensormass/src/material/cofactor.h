/* Cofactors of a 3x3 matrix of V8, real or complex lanes; a part of every kernel over tetrahedra. */

/* Computes the cofactors of F. */
INSIDE void TM_NAME(cofactors)(const V8 F[9], V8 cof[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = 3 * ((i + 1) % 3), b = 3 * ((i + 2) % 3), c = (j + 1) % 3, d = (j + 2) % 3;
            cof[3 * i + j] = F[a + c] * F[b + d] - F[a + d] * F[b + c];
        }
}
