/* libtensormass: soft-tissue simulation with haptic feedback. Tensor/mass finite elements, explicit dynamics, contact
 * and cutting. SI units everywhere. Depends on the C library and libm only. Never prints, never exits, never allocates
 * in a step. */
#ifndef TENSORMASS_H
#define TENSORMASS_H

#include "tensormass/base.h"
#include "tensormass/contact.h"
#include "tensormass/cut.h"
#include "tensormass/energy.h"
#include "tensormass/friction.h"
#include "tensormass/grasp.h"
#include "tensormass/material.h"
#include "tensormass/mesh.h"
#include "tensormass/model.h"
#include "tensormass/patch.h"
#include "tensormass/rotation.h"
#include "tensormass/ties.h"
#include "tensormass/tissue.h"
#include "tensormass/touch.h"
#include "tensormass/viscosity.h"
#include "tensormass/world.h"

#endif
