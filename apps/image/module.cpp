// The module's one symbol.
#include "module.h"

extern "C" {
__attribute__((visibility("default"))) extern const image_api image_api_2;
const image_api image_api_2 = {image_read, image_mesh, image_read_surface, image_examine_surface};
}
