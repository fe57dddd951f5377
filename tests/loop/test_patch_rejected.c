/* Patches that the controller rejects. */
#include "ground_patch.h"

/* The last vertex becomes the tip's node. */
static void hold_something(hrt_patch *p) {
    int32_t kept = 0;
    p->vertex_count--;
    for (int32_t t = 0; t < p->triangle_count; t++) {
        const uint8_t *corner = &p->triangle[3 * t];
        if (corner[0] == p->vertex_count || corner[1] == p->vertex_count || corner[2] == p->vertex_count) continue;
        p->face[kept] = p->face[t];
        memmove(&p->triangle[3 * kept++], corner, 3);
    }
    p->triangle_count = kept;
    p->grasped = 1u << p->vertex_count | 6u << 10;
    for (int i = 0; i < 3 * p->vertex_count; i++)
        for (int c = 0; c < 3; c++)
            p->compliance_m_N[packed(3 * VERTICES, i, 3 * p->vertex_count + c)] = c == i % 3 ? 0.5f : 0.0f;
    for (int i = 0; i < 6; i++)
        p->compliance_m_N[HRT_PATCH_COMPLIANCE - 6 + i] = i == 0 || i == 3 || i == 5 ? -300.0f : 0.0f;
    for (int c = 0; c < 3; c++) {
        p->vertex_m[hrt_patch_tip(p) + c] = c == 2 ? 0.118f : 0.0f;
        p->rest_m[hrt_patch_tip(p) + c] = 1.0f;
    }
}

/* Returns the verdict on the good patch after `spoil` has changed it, for cases 0, 1, ... */
static void refused(void (*spoil)(hrt_patch *p, int what), bool held, const hrt_reject *verdict, int count) {
    static hrt_patch p;
    ground(0.0005f);
    for (int what = 0; what < count; what++) {
        p = patch;
        if (held) hold_something(&p);
        spoil(&p, what);
        const hrt_reject told = hrt_patch_prepare(&p, scratch);
        if (told != verdict[what]) print_message("case %d\n", what);
        assert_int_equal(told, verdict[what]);
    }
}

static void spoil_patch(hrt_patch *p, int what) {
    switch (what) {
    case 1: p->vertex_count = 25; break;
    case 2: p->triangle_count = 33; break;
    case 3: p->triangle[5] = 24; break;
    case 4: p->triangle[1] = p->triangle[0]; break;
    case 5: p->vertex_m[7] = NAN; break;
    case 6: p->compliance_m_N[2627] = INFINITY; break;
    case 7: p->compliance_m_N[0] = -0.001f; break;
    case 8: p->compliance_m_N[3] = 0.01f; break; /* a coupling larger than its diagonal terms */
    case 9: p->radius_m = 1.0f; break;
    case 10: p->contact_compliance_m_N = -1.0f; break;
    case 11: memset(p->compliance_m_N, 0, sizeof p->compliance_m_N); break; /* rigid: semidefinite */
    case 12: p->vertex_count = 2; break;
    case 13: p->rest_m[3] = NAN; break;
    case 14: p->grasped = 1u << VERTICES; break; /* no node for the tip */
    default: break;
    }
}

static void bad_patches_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {HRT_ACCEPT,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_ASYMMETRIC,
                                         HRT_REJECT_ASYMMETRIC,
                                         HRT_REJECT_HUGE,
                                         HRT_REJECT_HUGE,
                                         HRT_ACCEPT,
                                         HRT_REJECT_INDEX,
                                         HRT_REJECT_NOT_FINITE,
                                         HRT_REJECT_INDEX};
    refused(spoil_patch, false, verdict, sizeof verdict / sizeof *verdict);
}

static void spoil_hold(hrt_patch *p, int what) {
    float *stiffness = &p->compliance_m_N[HRT_PATCH_COMPLIANCE - 6];
    switch (what) {
    case 1: p->grasped = 3u; break; /* grasped vertices without a grasp */
    case 2: p->grasped |= 1u << (VERTICES + 4); break;
    case 3: stiffness[0] = 200.0f; break;         /* pushes on instead of resisting */
    case 4: p->compliance_m_N[69] = 11.0f; break; /* a vertex that moves more than the tip */
    case 5: p->compliance_m_N[70] = NAN; break;
    case 6: p->rest_m[hrt_patch_tip(p)] = 1001.0f; break; /* the force */
    case 7: p->vertex_m[hrt_patch_tip(p) + 2] = NAN; break;
    case 8: stiffness[5] = -2.0e9f; break;
    case 9: stiffness[1] = 400.0f; break; /* indefinite */
    default: break;
    }
}

static void bad_grasps_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {
        HRT_ACCEPT,      HRT_REJECT_INDEX,      HRT_REJECT_INDEX, HRT_REJECT_ASYMMETRIC,
        HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE,  HRT_REJECT_NOT_FINITE,
        HRT_REJECT_HUGE, HRT_REJECT_ASYMMETRIC};
    refused(spoil_hold, true, verdict, sizeof verdict / sizeof *verdict);
}

static void spoil_drag(hrt_patch *p, int what) {
    switch (what) {
    case 0: p->radiation_N_s_m = -0.1f; break; /* drives instead of resisting */
    case 1: p->radiation_s = NAN; break;
    case 2: p->radiation_N_s_m = 11.0f; break;
    case 3: p->friction_static = 2.1f; break;
    case 4: p->friction_static = 0.2f, p->friction_kinetic = 0.3f; break;
    case 5: p->friction_static = NAN; break;
    case 6: p->friction_kinetic = -0.1f; break;
    case 7: p->friction_static = 2.0f, p->friction_kinetic = 2.0f; break;
    default: break;
    }
}

static void bad_drags_are_rejected(void **state) {
    (void)state;
    static const hrt_reject verdict[] = {HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE, HRT_REJECT_HUGE,
                                         HRT_REJECT_HUGE, HRT_REJECT_NOT_FINITE, HRT_REJECT_HUGE, HRT_ACCEPT};
    refused(spoil_drag, true, verdict, sizeof verdict / sizeof *verdict);
}

/* For any patch that passes the check, the tick stays finite and bounded. */
static void wild_patches_stay_bounded(void **state) {
    (void)state;
    static hrt_extrapolation x;
    static hrt_patch p[2];
    uint64_t seed = 77;
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    int taken = 0;
    for (int k = 0; k < 3000; k++) {
        hrt_patch *q = &p[k % 2];
        make_ground(q, &seed, rig_uniform(&seed, 0.0f, 0.006f), rig_uniform(&seed, 0.0f, 0.01f), 0.12f);
        if (k % 3 == 0)
            for (int i = 0; i < 96; i++) q->triangle[i] = (uint8_t)(rig_random(&seed) % VERTICES);
        if (k % 5 == 0) memset(q->compliance_m_N, 0, sizeof q->compliance_m_N);
        if (k % 7 == 0) q->contact_compliance_m_N = 0.0f;
        if (k % 4 == 0) hold_something(q);
        if (k / 16 % 2) q->friction_static = 2.0f, q->friction_kinetic = rig_uniform(&seed, 0.0f, 2.0f);
        if (hrt_patch_prepare(q, scratch) != HRT_ACCEPT) continue;
        taken++;
        float tip[3] = {rig_uniform(&seed, -0.01f, 0.01f), rig_uniform(&seed, -0.01f, 0.01f),
                        rig_uniform(&seed, 0.11f, 0.13f)},
              force[3];
        if (k % 4 == 0)
            take_grasper(&x, 2000 * k, tip, q, (uint32_t)k);
        else
            take(&x, 2000 * k, tip, q, (uint32_t)k);
        for (int t = 0; t < 4; t++) {
            for (int i = 0; i < 3; i++) tip[i] += rig_uniform(&seed, -0.001f, 0.001f);
            hrt_extrapolation_force(&x, &params, 2000 * k + t, tip, force);
            for (int i = 0; i < 3; i++)
                assert_true(isfinite(force[i]) &&
                            fabsf(force[i]) <= 50.0f * HRT_CONTACT_ROWS * (1.5f + q->friction_static));
        }
    }
    assert_true(taken > 1500);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bad_patches_are_rejected), cmocka_unit_test(bad_grasps_are_rejected),
        cmocka_unit_test(bad_drags_are_rejected), cmocka_unit_test(wild_patches_stay_bounded)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
