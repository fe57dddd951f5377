/* libtensormass: soft tissue that can be felt. Tensor/mass finite elements, explicit dynamics, contact, cutting.
 * SI units everywhere. Depends on the C library and libm, prints nothing, exits nowhere, allocates nothing in a step.
 */
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
#include "tensormass/tissue.h"
#include "tensormass/viscosity.h"
#include "tensormass/world.h"

#endif
