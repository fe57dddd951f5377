/* What a scene may hold, looked at before libyaml builds it: nesting, aliases and directives cost it the square of
 * their number. */
#include <string.h>

#include "scene_reader.h"

/* Scenes of people have a depth of 5, no anchors and some hundred values. */
enum { MAX_DEPTH = 16, MAX_ANCHORS = 64, MAX_DIRECTIVES = 4, MAX_VALUES = 1000000 };

static tm_status too_many(const app_scene *scene, size_t line, const char *what, int most, const char *instead) {
    return app_host_bad(&scene->host, scene->file, (int)line + 1, "more than %d %s; %s", most, what, instead);
}

static tm_status check_directives(const app_scene *scene, const char *text, size_t size) {
    size_t line = 0;
    int count = 0;
    for (const char *at = text, *end = text + size; at < end; line++) {
        if (*at == '%' && ++count > MAX_DIRECTIVES)
            return too_many(scene, line, "lines that begin with %", MAX_DIRECTIVES, "leave them out");
        const char *stop = memchr(at, '\n', (size_t)(end - at));
        at = stop ? stop + 1 : end;
    }
    return 0;
}

/* What is not YAML passes: the reader that follows finds the same fault and knows better words. */
tm_status app_scene_check_limits(const app_scene *scene, const char *text, size_t size) {
    yaml_parser_t parser;
    yaml_event_t event;
    int depth = 0, anchors = 0, values = 0, rc = check_directives(scene, text, size);
    bool going = !rc && yaml_parser_initialize(&parser), made = going;
    if (going) yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    while (going && yaml_parser_parse(&parser, &event)) {
        size_t line = event.start_mark.line;
        const unsigned char *anchor = NULL;
        going = event.type != YAML_STREAM_END_EVENT;
        switch (event.type) {
        case YAML_SEQUENCE_START_EVENT:
            anchor = event.data.sequence_start.anchor;
            depth++;
            break;
        case YAML_MAPPING_START_EVENT:
            anchor = event.data.mapping_start.anchor;
            depth++;
            break;
        case YAML_SEQUENCE_END_EVENT:
        case YAML_MAPPING_END_EVENT: depth--; break;
        case YAML_SCALAR_EVENT:
            anchor = event.data.scalar.anchor;
            values++;
            break;
        case YAML_ALIAS_EVENT: anchor = event.data.alias.anchor; break;
        default: break;
        }
        anchors += anchor != NULL;
        if (depth > MAX_DEPTH)
            rc = too_many(scene, line, "levels of lists and mappings in each other", MAX_DEPTH, "a scene needs five");
        else if (anchors > MAX_ANCHORS)
            rc = too_many(scene, line, "anchors (&) and aliases (*)", MAX_ANCHORS, "write the values out");
        else if (values > MAX_VALUES)
            rc = too_many(scene, line, "values", MAX_VALUES, "give a scene, not a mesh");
        yaml_event_delete(&event);
        going = going && !rc;
    }
    if (made) yaml_parser_delete(&parser);
    return rc;
}

/* libyaml's words, and what people meant. */
const char *app_scene_yaml_remedy(const char *text, size_t size, size_t line, const char *problem) {
    const char *at = text, *end = text + size;
    for (; line && at < end; line--) {
        const char *stop = memchr(at, '\n', (size_t)(end - at));
        at = stop ? stop + 1 : end;
    }
    const char *stop = at < end ? memchr(at, '\n', (size_t)(end - at)) : NULL;
    size_t length = (size_t)((stop ? stop : end) - at), blank = 0;
    while (blank < length && (at[blank] == ' ' || at[blank] == '\t')) blank++;
    if (memchr(at, '\t', blank)) return "indent with spaces, not with tabs";
    if (problem && (strstr(problem, "alphabetic") || strstr(problem, "alias")) && memchr(at, '*', length))
        return "put the asterisk in quotes: \"*\":";
    if (problem && strstr(problem, "mapping values are not allowed"))
        return "put a text that has a colon in quotes, and a key on a line of its own";
    if (problem && strstr(problem, "did not find expected"))
        return "look for a bracket, a quote or an indentation that is not closed";
    return "correct the line";
}
