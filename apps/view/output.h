/* Output of pictures: PNG files, numbered PNG files, and video through ffmpeg. */
#ifndef VIEW_OUTPUT_H
#define VIEW_OUTPUT_H

#include <stdio.h>
#include <sys/types.h>

#include "app.h"

/* Writes the complete file or none. `level`: compression, 1 to 9. */
tm_status view_png_write(const char *path, int width, int height, const uint8_t *rgb, tm_error *error);

typedef struct view_video {
    FILE *pipe;
    pid_t encoder;
    app_output output;
    int width, height;
    int64_t frames;
} view_video;

/* Begins an H.264 video in MP4. Sizes must be even. */
tm_status view_video_begin(view_video *video, const char *path, int width, int height, int fps, tm_error *error);
tm_status view_video_add(view_video *video, const uint8_t *rgb, tm_error *error);
tm_status view_video_end(view_video *video, tm_error *error);
/* Abandons the video; no file remains. */
void view_video_abandon(view_video *video);

#endif
