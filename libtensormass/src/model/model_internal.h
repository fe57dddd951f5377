/* Internals of the models of an organ, the top component. */
#ifndef TM_MODEL_INTERNAL_H
#define TM_MODEL_INTERNAL_H

#include "patch/patch_internal.h"
#include "tensormass/model.h"

enum { TM_COOKIE_MODEL = 0x6d6f646c };

#endif
