/* Where the picture is taken from. */
#ifndef VIEW_CAMERA_H
#define VIEW_CAMERA_H

#include "picture.h"

typedef struct view_camera {
    float eye_m[3], at_m[3], up[3]; /* up is a unit axis, either way */
    float fov_rad;                  /* of the picture's height */
    float middle_m[3], radius_m;    /* of what it was fitted to */
    float floor_m;                  /* lowest point of that, along up */
} view_camera;

typedef struct view_camera_def {
    float azimuth_rad, elevation_rad; /* of the eye, seen from the middle */
    float zoom;                       /* 1: the tissue fills the picture; 2: twice as large */
    float shift[2];                   /* right and up, in parts of the picture's height */
    char up;                          /* 'x', 'y' or 'z'; 'X' 'Y' 'Z': the other way */
} view_camera_def;

view_camera_def view_camera_default(void);
/* Fits the camera to the surface. The surface must have a vertex. */
view_camera view_camera_fit(const view_camera_def *def, const view_surface *surface, int width, int height);
/* Column-major matrices, as OpenGL takes them. */
void view_camera_matrices(const view_camera *camera, int width, int height, float view[16], float projection[16]);
/* Pixel of a point, top row 0; false behind the eye. */
bool view_camera_project(const view_camera *camera, int width, int height, const double point_m[3], float pixel[2]);
/* 1: a direction at a point runs towards the eye, within 30 degrees; -1: away from it; 0: across. */
int view_camera_facing(const view_camera *camera, const double point_m[3], const double direction[3]);
/* Two unit vectors at right angles to `axis` and to each other. */
void view_frame(const float axis[3], float u[3], float v[3]);

#endif
