#include "drive_haply_json.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

static const double TRIGGER_FULL = 255.0; /* the trigger is a byte */

static cJSON *entry(const cJSON *root, const char *list, int32_t number) {
    return cJSON_GetArrayItem(cJSON_GetObjectItemCaseSensitive(root, list), number);
}

static const cJSON *at(const cJSON *object, const char *name) { return cJSON_GetObjectItemCaseSensitive(object, name); }

static bool number_of(const cJSON *object, const char *name, double *value) {
    const cJSON *item = at(object, name);
    if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble)) return false;
    *value = item->valuedouble;
    return true;
}

static bool vector_of(const cJSON *object, double v[3]) {
    return number_of(object, "x", &v[0]) && number_of(object, "y", &v[1]) && number_of(object, "z", &v[2]);
}

static bool copy_text(const cJSON *item, char out[HRT_HAPLY_ID]) {
    if (!cJSON_IsString(item) || strlen(item->valuestring) >= HRT_HAPLY_ID) return false;
    for (const char *c = item->valuestring; *c; c++) /* it goes back into JSON text */
        if (*c < ' ' || *c == '"' || *c == '\\') return false;
    strcpy(out, item->valuestring);
    return true;
}

static void read_filters(const cJSON *config, hrt_haply_device *device) {
    const cJSON *filters = at(config, "filters");
    number_of(at(filters, "force_gate"), "gain", &device->force_gate);
    number_of(at(filters, "damping"), "scalar", &device->damping);
}

bool hrt_haply_inventory(const char *text, int32_t number, hrt_haply_device *device, char *why, int why_size) {
    cJSON *root = cJSON_Parse(text);
    const cJSON *list = at(root, "inverse3"), *item = entry(root, "inverse3", number), *config = at(item, "config");
    *device = (hrt_haply_device){.number = number, .force_gate = -1.0, .damping = -1.0};
    bool good = false;
    if (!cJSON_IsArray(list))
        snprintf(why, (size_t)why_size,
                 "its first message is not an inventory of Haply devices; update the Haply Inverse Service");
    else if (!item)
        snprintf(why, (size_t)why_size, "the service has %d Inverse3; plug it in, or choose a lower number",
                 cJSON_GetArraySize(list));
    else if (!copy_text(at(item, "device_id"), device->id))
        snprintf(why, (size_t)why_size,
                 "the inventory gives the device no device_id; update the Haply Inverse Service");
    else
        good = true;
    if (good && !copy_text(at(config, "type"), device->type)) strcpy(device->type, "inverse3");
    device->is_3_5 = at(root, "session_id") || at(root, "session") || at(config, "filters") || at(config, "basis");
    if (good) read_filters(config, device);
    cJSON_Delete(root);
    return good;
}

int hrt_haply_print(const char *text, FILE *file) {
    cJSON *root = cJSON_Parse(text);
    const cJSON *list = at(root, "inverse3");
    const int count = cJSON_IsArray(list) ? cJSON_GetArraySize(list) : -1;
    cJSON_Delete(root);
    for (int i = 0; i < count; i++) {
        hrt_haply_device device;
        char why[120];
        if (hrt_haply_inventory(text, i, &device, why, sizeof why))
            fprintf(file, "  haply:%-10d %s %s, service %s\n", i, device.type, device.id,
                    device.is_3_5 ? "3.5 or later" : "before 3.5");
    }
    return count;
}

/* Reads the first handle of a kind, preferring the device's own number. Returns false if there is none. */
static bool read_grip(const cJSON *root, const char *kind, int32_t number, hrt_drive_state *state) {
    static const char *const name[2][HRT_DRIVE_BUTTONS] = {{"a", "b", "c", ""}, {"down", "up", "right", "left"}};
    const cJSON *item = entry(root, kind, number), *grip = at(item ? item : entry(root, kind, 0), "state");
    if (!grip) return false;
    const cJSON *buttons = at(grip, "buttons"), *q = at(grip, "orientation");
    double xyz[3], w, trigger;
    for (int n = 0; n < 2; n++)
        for (int b = 0; b < HRT_DRIVE_BUTTONS; b++)
            if (cJSON_IsTrue(at(buttons, name[n][b]))) state->button[b] = true;
    if (cJSON_IsTrue(at(grip, "button"))) state->button[0] = true;
    if (vector_of(q, xyz) && number_of(q, "w", &w)) {
        memcpy(state->orientation, xyz, sizeof xyz);
        state->orientation[3] = w;
    }
    if (number_of(grip, "trigger", &trigger)) state->trigger = fmin(fmax(trigger / TRIGGER_FULL, 0.0), 1.0);
    return true;
}

static const cJSON *find_device(const cJSON *root, const hrt_haply_device *device) {
    const cJSON *item;
    cJSON_ArrayForEach(item, at(root, "inverse3")) {
        const cJSON *id = at(item, "device_id");
        if (cJSON_IsString(id) && strcmp(id->valuestring, device->id) == 0) return item;
    }
    return NULL;
}

bool hrt_haply_state(const char *text, hrt_haply_device *device, hrt_drive_state *state, const char **trouble) {
    static const char *const grips[] = {"wireless_verse_grip", "custom_verse_grip", "verse_grip"};
    cJSON *root = cJSON_Parse(text);
    const cJSON *item = find_device(root, device), *status = at(item, "status");
    *state = (hrt_drive_state){.trigger = -1.0};
    *trouble = cJSON_IsFalse(at(status, "power_supply")) ? "the device has no power supply; plug it in"
               : cJSON_IsFalse(at(status, "calibrated")) ? "the device is not calibrated; follow its light"
                                                         : NULL;
    const bool good = vector_of(at(at(item, "state"), "cursor_position"), state->cursor_m);
    if (good) read_filters(at(item, "config"), device);
    for (size_t k = 0; good && k < sizeof grips / sizeof *grips; k++)
        if (read_grip(root, grips[k], device->number, state)) break;
    cJSON_Delete(root);
    return good;
}

int hrt_haply_command(char text[HRT_HAPLY_COMMAND_MAX], const hrt_haply_device *device, const float force_N[3],
                      bool first) {
    const char *session = !first           ? ""
                          : device->is_3_5 ? "\"session\":{\"configure\":{\"profile\":{\"name\":\"tensormass\"}},"
                                             "\"force_render_full_state\":{}},"
                                           : "\"session\":{\"force_render_full_state\":{}},";
    const char *filters =
        first && device->is_3_5 ? "\"configure\":{\"force_gate\":{\"gain\":0},\"damping\":{\"scalar\":0}}," : "";
    return snprintf(text, HRT_HAPLY_COMMAND_MAX,
                    "{%s\"inverse3\":[{\"device_id\":\"%s\",%s\"commands\":{\"set_cursor_force\":"
                    "{\"%s\":{\"x\":%.5f,\"y\":%.5f,\"z\":%.5f}}}}]}",
                    session, device->id, filters, device->is_3_5 ? "vector" : "values", (double)force_N[0],
                    (double)force_N[1], (double)force_N[2]);
}
