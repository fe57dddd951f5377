// Functions that module.cpp enters into the module's table.
#ifndef IMAGE_MODULE_H
#define IMAGE_MODULE_H

#include "image_api.h"

image_end image_read(const char *path, double unit_m, image_volume *out, char why[IMAGE_WHY]);
image_end image_read_vectors(const char *path, image_vectors *out, char why[IMAGE_WHY]);
// Recognises DICOM files by their first bytes, regardless of their names; throws what is wrong (refusal.h).
bool image_is_dicom(const char *path);
void image_read_dicom(const char *path, image_volume *out);
image_end image_mesh(const image_domain *domain, const image_request *request, image_tets *out, char why[IMAGE_WHY]);
image_end image_read_surface(const char *path, image_surface *out, char why[IMAGE_WHY]);
image_end image_examine_surface(image_surface *surface, bool repair, image_defects *found, image_defects *left,
                                char why[IMAGE_WHY]);

#endif
