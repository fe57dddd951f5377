/* Vectors of three doubles. */
#ifndef TM_VEC_H
#define TM_VEC_H

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

#endif
