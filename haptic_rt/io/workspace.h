/* Maps a cursor on the desk to the tip of an instrument and the tip's force back to the cursor.
 *
 * The cursor's axes are the user's: x right, y away, z up, m and N. The tip's are the device's joints
 * (core/device_cursor.h): x left, y away, z into the body. tip = offset + scale * turned(cursor), force at the cursor =
 * min(scale, 1) * turned_back(force at the tip). The power at the cursor is never above that at the tip: their ratio is
 * min(1, 1/scale).
 *
 * While the clutch is pressed the cursor moves freely and the tip stays. The tip follows until the force has faded, so
 * that no motion goes unaccounted while force is rendered; on release the offset makes the tip continue where it is.
 *
 * The shaft of an instrument without a trocar follows the handle's rotation, one to one: tool = handle * offset, as
 * unit quaternions along the user's axes. At the start the offset is 1; at the release of the clutch it makes the shaft
 * continue where it is. Without torque at the handle, rotation carries no power to the hand. */
#ifndef HRT_WORKSPACE_H
#define HRT_WORKSPACE_H

#include <stdbool.h>
#include <stdint.h>

typedef enum hrt_clutch {
    HRT_CLUTCH_FOLLOWS = 0, /* the tip follows the cursor */
    HRT_CLUTCH_FADES,       /* pressed; the tip follows until no force is rendered */
    HRT_CLUTCH_HELD         /* the tip stays */
} hrt_clutch;

typedef struct hrt_workspace {
    /* set before the first cursor */
    double scale;         /* tip metres per cursor metre, HRT_SCALE_MIN..HRT_SCALE_MAX; default 1 */
    double depth_m;       /* z of the tip where the cursor is first; default 0.1 */
    int32_t clutch, grip; /* buttons, -1: none; default 0 and 1 */
    /* state */
    bool placed;
    hrt_clutch state;
    double offset_m[3], tip_m[3];
    double roll_rad, roll_last_rad, roll_wanted_rad, grip_now;
    bool roll_known;
    bool oriented, turned_away; /* an orientation is known; the clutch holds the shaft, not the handle */
    double tool[4], offset[4];  /* x, y, z, w */
    bool lags;                  /* the tilt is not yet the handle's */
    double tilt_rad[2];         /* of the shaft from z, towards x and y of the tip's axes */
} hrt_workspace;

static const double HRT_SCALE_MIN = 0.05, HRT_SCALE_MAX = 2.0;

hrt_workspace hrt_workspace_default(void);
/* Maps the cursor, m, and updates the clutch. pressed: the clutch's button. force_on: force is rendered. Returns false
 * while force must be withheld (clutch pressed). The result is in tip_m. */
bool hrt_workspace_follow(hrt_workspace *w, const double cursor_m[3], bool pressed, bool force_on);
/* Returns the force at the cursor, N, for one at the tip along the joint axes. */
void hrt_workspace_force(const hrt_workspace *w, const float tip_N[3], float cursor_N[3]);
/* Returns the torque at the handle, N m. Force and torque together have the power of the tip's force at the tip, times
 * the smaller of 1 and 1 / scale. */
void hrt_workspace_torque(const hrt_workspace *w, const float tip_Nm[3], float cursor_Nm[3]);
/* Updates the roll from the handle's orientation (x, y, z, w of a unit quaternion): its rotation about the cursor's z
 * axis, continued over full turns, within 9.9 rad. */
void hrt_workspace_roll(hrt_workspace *w, const double orientation[4]);
/* Updates the shaft's tilt and roll from the handle's orientation; call it after hrt_workspace_follow. The handle's -z
 * is the shaft's direction. Tilts are within 2.5 rad. Tilt and roll change by at most 60 rad/s, half a turn away from
 * `axis` both are undefined; with an arm, by what moves the tip at 2 m/s. */
void hrt_workspace_orient(hrt_workspace *w, const double orientation[4], double arm_m, double dt_s);
/* Moves the grip towards `wanted`, 0 to 1, at 8 a second at most: a button closes in an eighth of a second. */
void hrt_workspace_grip(hrt_workspace *w, double wanted, double dt_s);

#endif
