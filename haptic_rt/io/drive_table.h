/* The kinds of drives: a row here, and a file drive_KIND.c that defines hrt_drive_KIND. Programs that link the drivers
 * use it; the node needs drive.h alone. */
#ifndef HRT_DRIVE_TABLE_H
#define HRT_DRIVE_TABLE_H

#include "drive.h"

#define HRT_DRIVES(ROW) ROW(haply) ROW(touch) ROW(omega) ROW(falcon) ROW(odrive) ROW(moteus) ROW(cia402) ROW(crtk)

#endif
