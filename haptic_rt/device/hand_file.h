/* Hand scripts from CSV: time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip[,active]. */
#ifndef HRT_HAND_FILE_H
#define HRT_HAND_FILE_H

#include "device.h"

/* Fills script->key (free() it) and key_count. False with a message on stderr. */
bool hrt_hand_file_read(const char *path, hrt_hand_script *script);

#endif
