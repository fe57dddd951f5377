// Table of the module's symbols.
#include "module.h"

extern "C" {
__attribute__((visibility("default"))) extern const image_api image_api_2;
const image_api image_api_2 = {image_read, image_mesh, image_read_surface, image_examine_surface};
__attribute__((visibility("default"))) extern const image_vectors_api image_vectors_1;
const image_vectors_api image_vectors_1 = {image_read_vectors};
}
