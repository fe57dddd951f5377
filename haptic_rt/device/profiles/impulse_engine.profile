# Laparoscopic Impulse Engine. No public data sheet is available: the force of 8.9 N (2 lbf) and a resolution near 0.02 mm are the maker's
# published values for the family; the other values are plausible estimates, to be measured on a real device.
device = impulse_engine
# Joints: pitch rad, yaw rad, insertion m, roll rad, grip 0..1. Names, units and ranges: haptic-rt --params.
counts_per_unit = 8000 8000 40000 700 250
count_zero = 0 0 0 0 0
joint_min = -0.8 -0.8 0.01 -10 0
joint_max = 0.8 0.8 0.25 10 1
speed_max = 20 20 3 100 50
torque_max = 1.4 1.4 8.9
force_max_N = 8.9
