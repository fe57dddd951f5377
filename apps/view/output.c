#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <png.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

static tm_status failed(tm_error *error, tm_status status, const char *what, const char *why) {
    error->status = status, error->entity = -1;
    snprintf(error->message, sizeof error->message, "%s: %s", what, why);
    return status;
}

tm_status view_png_write(const char *path, int width, int height, const uint8_t *rgb, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return error->status;
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (png_uint_32)width,
                       .height = (png_uint_32)height,
                       .format = PNG_FORMAT_RGB};
    image.flags = PNG_IMAGE_FLAG_FAST;
    FILE *file = app_output_stream(&output);
    bool written = file && png_image_write_to_stdio(&image, file, 0, rgb, 0, NULL);
    if (file && fclose(file)) written = false;
    if (!written) {
        app_output_abandon(&output);
        return failed(error, TM_ERR_FILE, "the picture could not be written", image.message);
    }
    return app_output_commit(&output, error) ? TM_OK : error->status;
}

/* Starts ffmpeg with pictures from `in`. Returns 0 or an errno value. */
static int start_ffmpeg(view_video *video, int in, int fps) {
    char size[32], rate[16];
    snprintf(size, sizeof size, "%dx%d", video->width, video->height);
    snprintf(rate, sizeof rate, "%d", fps);
    /* bitexact and one thread: equal pictures give equal videos. */
    char *argv[] = {"ffmpeg",
                    "-nostdin",
                    "-loglevel",
                    "error",
                    "-y",
                    "-f",
                    "rawvideo",
                    "-pix_fmt",
                    "rgb24",
                    "-s",
                    size,
                    "-r",
                    rate,
                    "-i",
                    "-",
                    "-an",
                    "-c:v",
                    "libx264",
                    "-preset",
                    "veryfast",
                    "-crf",
                    "19",
                    "-pix_fmt",
                    "yuv420p",
                    "-fflags",
                    "+bitexact",
                    "-flags:v",
                    "+bitexact",
                    "-map_metadata",
                    "-1",
                    "-movflags",
                    "+faststart",
                    "-f",
                    "mp4",
                    video->output.temporary,
                    NULL};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in, 0);
    posix_spawn_file_actions_adddup2(&actions, 2, 1);
    int wrong = posix_spawnp(&video->encoder, "ffmpeg", &actions, NULL, argv, environ);
    posix_spawn_file_actions_destroy(&actions);
    return wrong;
}

tm_status view_video_begin(view_video *video, const char *path, int width, int height, int fps, tm_error *error) {
    memset(video, 0, sizeof *video);
    video->width = width, video->height = height;
    if (width % 2 || height % 2)
        return failed(error, TM_ERR_ARGUMENT, "the width and height of a video must be even", "choose another --size");
    if (!app_output_begin(&video->output, path, error)) return error->status;
    int end[2];
    if (pipe2(end, O_CLOEXEC)) {
        app_output_abandon(&video->output);
        return failed(error, TM_ERR_FILE, "no pipe to ffmpeg can be opened", strerror(errno));
    }
    signal(SIGPIPE, SIG_IGN);
    int wrong = start_ffmpeg(video, end[0], fps);
    close(end[0]);
    if (wrong) {
        close(end[1]);
        app_output_abandon(&video->output);
        return failed(error, TM_ERR_FILE, "a video needs ffmpeg, which cannot be started",
                      wrong == ENOENT ? "it is not installed; apt-get install ffmpeg, or use --frames"
                                      : strerror(wrong));
    }
    video->pipe = fdopen(end[1], "wb");
    return TM_OK;
}

tm_status view_video_add(view_video *video, const uint8_t *rgb, tm_error *error) {
    if (fwrite(rgb, (size_t)video->width * 3, (size_t)video->height, video->pipe) != (size_t)video->height)
        return failed(error, TM_ERR_FILE, "ffmpeg ended early", "see its message above");
    video->frames++;
    return TM_OK;
}

static bool encoder_done(view_video *video) {
    int status = 0;
    bool flushed = fclose(video->pipe) == 0;
    video->pipe = NULL;
    while (waitpid(video->encoder, &status, 0) < 0 && errno == EINTR) {
    }
    return flushed && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

tm_status view_video_end(view_video *video, tm_error *error) {
    if (!encoder_done(video)) {
        app_output_abandon(&video->output);
        return failed(error, TM_ERR_FILE, "ffmpeg did not finish the video", "see its message above");
    }
    return app_output_commit(&video->output, error) ? TM_OK : error->status;
}

void view_video_abandon(view_video *video) {
    if (video->pipe) encoder_done(video);
    app_output_abandon(&video->output);
}
