/* Hand scripts from CSV: time_s, the device's joints by name, and active where there is a pedal. */
#ifndef HRT_HAND_FILE_H
#define HRT_HAND_FILE_H

#include "device.h"

/* Fills script->key (free() it) and key_count. False with a message on stderr. */
bool hrt_hand_file_read(const char *path, const hrt_device_type *device, hrt_hand_script *script);

#endif
