/* The room on top: models of an organ, made of what the rooms below give. */
#ifndef TM_MODEL_INTERNAL_H
#define TM_MODEL_INTERNAL_H

#include "patch/patch_internal.h"
#include "tensormass/model.h"

enum { TM_COOKIE_MODEL = 0x6d6f646c };

#endif
