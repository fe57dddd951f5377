/* Description shared by devices that report the position of a cursor and render a force there (io/drive.h): three
 * slides as of the desk, and a roll and a grip that no motor drives. The counts fit the 16 bits of the CAN frames;
 * drivers set finer ones. Reach and workspace are those of the tip after mapping (io/workspace.h), so the description
 * does not bound the device's own workspace: its driver does. */

#define CURSOR(name_, text_, force_N)                                                                                  \
    NAMED(name_, text_, "force_x_N", "force_y_N", "force_z_N").joints = 5, .motors = 3, .slides = true,                \
                                                  .joint = {JOINT("x_m", 50000.0f, -0.4f, 0.4f, 3.0f, -0.6f, 0.6f),    \
                                                            JOINT("y_m", 50000.0f, -0.4f, 0.4f, 3.0f, -0.6f, 0.6f),    \
                                                            JOINT("z_m", 50000.0f, -0.3f, 0.5f, 3.0f, -0.6f, 0.6f),    \
                                                            JOINT("roll_rad", 700.0f, -10.0f, 10.0f, 100.0f, -1.0e3f,  \
                                                                  1.0e3f),                                             \
                                                            JOINT("grip", 250.0f, 0.0f, 1.0f, 50.0f, -0.1f, 1.1f)},    \
                                                  .torque_max = {force_N, force_N, force_N}, .force_max_N = force_N,   \
                                                  .rounding_m = 1.0e-6f, .insertion = -1, .roll = 3, .grip = 4,        \
                                                  GEOMETRY(desk)

/* The same with a handle whose direction is measured: its tilt from the joint axes' z, towards x and y. */
#define HANDLE(name_, text_, force_N)                                                                                  \
    NAMED(name_, text_, "force_x_N", "force_y_N", "force_z_N")                                                         \
        .joints = 7,                                                                                                   \
       .motors = 3, .slides = true, .tilts = true,                                                                     \
       .joint = {JOINT("x_m", 50000.0f, -0.4f, 0.4f, 3.0f, -0.6f, 0.6f),                                               \
                 JOINT("y_m", 50000.0f, -0.4f, 0.4f, 3.0f, -0.6f, 0.6f),                                               \
                 JOINT("z_m", 50000.0f, -0.3f, 0.5f, 3.0f, -0.6f, 0.6f),                                               \
                 JOINT("roll_rad", 700.0f, -10.0f, 10.0f, 100.0f, -1.0e3f, 1.0e3f),                                    \
                 JOINT("grip", 250.0f, 0.0f, 1.0f, 50.0f, -0.1f, 1.1f),                                                \
                 JOINT("tilt_x_rad", 10000.0f, -2.6f, 2.6f, 100.0f, -3.2f, 3.2f),                                      \
                 JOINT("tilt_y_rad", 10000.0f, -2.6f, 2.6f, 100.0f, -3.2f, 3.2f)},                                     \
       .torque_max = {force_N, force_N, force_N}, .force_max_N = force_N, .rounding_m = 1.0e-6f, .insertion = -1,      \
       .roll = 3, .grip = 4, GEOMETRY(desk)

/* Of a handle that takes torque. Inertia and hold are those of a hand about its wrist, by estimate: across an arm of
 * 0.1 m they are 0.2 kg, 300 N/m and 11 N s/m, as those of the slides. */
#define HANDLE_TURNING                                                                                                 \
    .turning = {.inertia_kg_m2 = 0.002,                                                                                \
                .viscous_Nm_s = 0.003,                                                                                 \
                .coulomb_Nm = 0.005,                                                                                   \
                .hand_stiffness_Nm = 3.0,                                                                              \
                .hand_damping_Nm_s = 0.11}

#define CURSOR_TWIN(mass_kg, viscous_N_s_m, coulomb_N)                                                                 \
    .inertia = {mass_kg, mass_kg, mass_kg}, .viscous = {viscous_N_s_m, viscous_N_s_m, viscous_N_s_m},                  \
    .coulomb = {coulomb_N, coulomb_N, coulomb_N}, .hand_stiffness = {300.0, 300.0, 300.0},                             \
    .hand_damping = {11.0, 11.0, 11.0}, .rest = {0.0, 0.0, 0.1}, .lever = desk_lever, GEOMETRY(desk)
