/* Reads hand scripts from CSV: time_s, the device's joints by name, and optionally active (the pedal). */
#ifndef HRT_HAND_FILE_H
#define HRT_HAND_FILE_H

#include "device.h"

/* Fills script->key (the caller frees it) and key_count. Returns false after a message on stderr. */
bool hrt_hand_file_read(const char *path, const hrt_device_type *device, hrt_hand_script *script);

#endif
