/* The camera of a picture. */
#ifndef VIEW_CAMERA_H
#define VIEW_CAMERA_H

#include "picture.h"

typedef struct view_camera {
    float eye_m[3], at_m[3], up[3]; /* up is a unit axis, either way */
    float fov_rad;                  /* vertical field of view */
    float middle_m[3], radius_m;    /* middle and radius of the surface that it was fitted to */
    float floor_m;                  /* lowest point of that surface, along up */
} view_camera;

typedef struct view_camera_def {
    float azimuth_rad, elevation_rad; /* angles of the eye, seen from the middle */
    float zoom;                       /* 1: the tissue fills the picture; 2: twice as large */
    float shift[2];                   /* right and up, as shares of the picture's height */
    char up;                          /* 'x', 'y' or 'z'; 'X', 'Y', 'Z': the opposite direction */
} view_camera_def;

view_camera_def view_camera_default(void);
/* Returns a camera fitted to the surface, which must have a vertex. */
view_camera view_camera_fit(const view_camera_def *def, const view_surface *surface, int width, int height);
/* Computes column-major matrices for OpenGL. */
void view_camera_matrices(const view_camera *camera, int width, int height, float view[16], float projection[16]);
/* Computes the pixel of a point, top row 0. Returns false if the point is behind the eye. */
bool view_camera_project(const view_camera *camera, int width, int height, const double point_m[3], float pixel[2]);
/* Returns 1 if a direction at a point runs towards the eye within 30 degrees, -1 away from it, 0 across. */
int view_camera_facing(const view_camera *camera, const double point_m[3], const double direction[3]);
/* Computes two unit vectors perpendicular to `axis` and to each other. */
void view_frame(const float axis[3], float u[3], float v[3]);

#endif
