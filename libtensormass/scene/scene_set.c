/* --set PATH=VALUE and --unset PATH: changes a scene's document before it is read. */
#include <stdlib.h>
#include <string.h>

#include "scene_reader.h"

/* Copies a node of `from` into the scene's document, with the line of this --set. */
static int copy_node(reader *r, yaml_document_t *from, int index, int set, int depth) {
    yaml_node_t *node = yaml_document_get_node(from, index);
    int made = 0;
    if (!node || depth > 8) return 0;
    if (node->type == YAML_SCALAR_NODE) {
        made = yaml_document_add_scalar(&r->document, NULL, node->data.scalar.value, (int)node->data.scalar.length,
                                        node->data.scalar.style);
    } else if (node->type == YAML_SEQUENCE_NODE) {
        made = yaml_document_add_sequence(&r->document, NULL, YAML_ANY_SEQUENCE_STYLE);
        for (yaml_node_item_t *i = node->data.sequence.items.start; made && i != node->data.sequence.items.top; i++) {
            int item = copy_node(r, from, *i, set, depth + 1);
            if (!item || !yaml_document_append_sequence_item(&r->document, made, item)) return 0;
        }
    } else {
        made = yaml_document_add_mapping(&r->document, NULL, YAML_ANY_MAPPING_STYLE);
        for (yaml_node_pair_t *p = node->data.mapping.pairs.start; made && p != node->data.mapping.pairs.top; p++) {
            int key = copy_node(r, from, p->key, set, depth + 1), value = copy_node(r, from, p->value, set, depth + 1);
            if (!key || !value || !yaml_document_append_mapping_pair(&r->document, made, key, value)) return 0;
        }
    }
    if (made) node_at(r, made)->start_mark.line = SET_LINE + (unsigned)set;
    return made;
}

static int parse_set_value(reader *r, const char *text, int set) {
    yaml_parser_t parser;
    yaml_document_t document;
    if (!*text) text = "~";
    if (!yaml_parser_initialize(&parser)) return 0;
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, strlen(text));
    int made = 0;
    if (yaml_parser_load(&parser, &document)) {
        made = copy_node(r, &document, 1, set, 0);
        yaml_document_delete(&document);
    }
    yaml_parser_delete(&parser);
    return made;
}

static int set_key(reader *r, const char *name, int set) {
    int key = yaml_document_add_scalar(&r->document, NULL, (const unsigned char *)name, -1, YAML_PLAIN_SCALAR_STYLE);
    if (key) node_at(r, key)->start_mark.line = SET_LINE + (unsigned)set;
    return key;
}

static int line_of_set(int set) { return -(set + 1); }

/* Returns a mapping's pair with this key, null if there is none. */
static yaml_node_pair_t *find_pair(reader *r, yaml_node_t *mapping, const char *name) {
    for (yaml_node_pair_t *p = mapping->data.mapping.pairs.start; p != mapping->data.mapping.pairs.top; p++) {
        const yaml_node_t *key = node_at(r, p->key);
        if (key->type == YAML_SCALAR_NODE && !strcmp((const char *)key->data.scalar.value, name)) return p;
    }
    return NULL;
}

/* Returns whether --set created the list; its items are then appended one by one. */
static bool is_made(const yaml_node_t *list) { return list->start_mark.line >= SET_LINE; }

/* Refuses a --set whose path does not end in a list item. */
static tm_status refuse_item(reader *r, int set, const yaml_node_t *node, const char *rest, long count) {
    const int line = line_of_set(set);
    if (node->type != YAML_SEQUENCE_NODE)
        return app_scene_bad(r->scene, line, "%s belongs to %s, not to a list; leave the brackets out", rest,
                             app_scene_node_kind(node));
    if (is_made(node))
        return app_scene_bad(r->scene, line, "the list has no item %s, nor is it the next one; write [%ld]", rest,
                             count);
    return app_scene_bad(r->scene, line, "list item %s does not exist; give an index below %ld", rest, count);
}

/* "[2].rest": descends into the list's item, or replaces it at the end of the path. Appends to a list that --set
 * created. */
static tm_status enter_item(reader *r, int set, int value, char **rest, int *at) {
    yaml_node_t *node = node_at(r, *at);
    char *close;
    long index = strtol(*rest + 1, &close, 10);
    const bool list = node->type == YAML_SEQUENCE_NODE;
    long count = list ? node->data.sequence.items.top - node->data.sequence.items.start : 0;
    const bool next = list && is_made(node) && index == count && close != *rest + 1;
    if (*close != ']' || index < 0 || (index >= count && !next)) return refuse_item(r, set, node, *rest, count);
    *rest = close + 1 + (close[1] == '.');
    if (next) {
        const int list_number = *at;
        *at = **rest ? yaml_document_add_mapping(&r->document, NULL, YAML_ANY_MAPPING_STYLE) : value;
        if (!*at || !yaml_document_append_sequence_item(&r->document, list_number, *at))
            return app_scene_fail(r->scene, line_of_set(set), TM_ERR_MEMORY, "out of memory; use a smaller value");
        node_at(r, *at)->start_mark.line = SET_LINE + (unsigned)set;
        return 0;
    }
    if (!**rest) node->data.sequence.items.start[index] = value;
    *at = node->data.sequence.items.start[index];
    return 0;
}

/* Puts `name: child` into the mapping `at`, replacing an old value. The mapping is found by index, since it moves as
 * the document grows. */
static tm_status put_key(reader *r, int set, int at, const char *name, int child) {
    int key = set_key(r, name, set);
    yaml_node_pair_t *found = find_pair(r, node_at(r, at), name);
    if (key && child && found) *found = (yaml_node_pair_t){key, child};
    if (key && child && (found || yaml_document_append_mapping_pair(&r->document, at, key, child))) return 0;
    return app_scene_fail(r->scene, line_of_set(set), TM_ERR_MEMORY, "out of memory; use a smaller value");
}

/* Returns the length of the path's first name: of a key that the mapping has, dots included ("liver.*" of materials),
 * else up to the next dot or bracket. */
static size_t length_of_name(reader *r, const yaml_node_t *mapping, const char *path) {
    size_t length = strcspn(path, ".[");
    for (const yaml_node_pair_t *p = mapping->data.mapping.pairs.start; p < mapping->data.mapping.pairs.top; p++) {
        const yaml_node_t *key = node_at(r, p->key);
        const size_t size = key->type == YAML_SCALAR_NODE ? key->data.scalar.length : 0;
        if (size > length && !strncmp(path, (const char *)key->data.scalar.value, size) && strchr(".[", path[size]))
            length = size;
    }
    return length;
}

/* "name.rest": descends into the key's value, creating it if missing. At the end of the path sets or removes the
 * value. */
static tm_status enter_key(reader *r, int set, int value, bool remove, char **rest, int *at) {
    yaml_node_t *node = node_at(r, *at);
    int line = line_of_set(set);
    char *name = *rest;
    if (node->type != YAML_MAPPING_NODE) {
        name[strcspn(name, ".[")] = 0;
        return app_scene_bad(r->scene, line, "%s is %s; name a key of a mapping", name, app_scene_node_kind(node));
    }
    const size_t length = length_of_name(r, node, name);
    const char next = name[length];
    name[length] = 0;
    yaml_node_pair_t *found = find_pair(r, node, name);
    *rest += length + (next == '.');
    if (remove && !found)
        return app_scene_bad(r->scene, line, "the scene has no '%s' to leave out; name one of its keys", name);
    if (remove && !next)
        *found = *--node->data.mapping.pairs.top;
    else if (found && next && !app_scene_null(node_at(r, found->value)))
        *at = found->value;
    else {
        int child = next == '[' ? yaml_document_add_sequence(&r->document, NULL, YAML_ANY_SEQUENCE_STYLE)
                    : next      ? yaml_document_add_mapping(&r->document, NULL, YAML_ANY_MAPPING_STYLE)
                                : value;
        if (child && next) node_at(r, child)->start_mark.line = SET_LINE + (unsigned)set;
        tm_status rc = put_key(r, set, *at, name, child);
        if (rc) return rc;
        *at = child;
    }
    if (next == '[') **rest = '[';
    return 0;
}

tm_status app_scene_apply_set(reader *r, int set) {
    const char *text = r->scene->set[set], *equals = strchr(text, '=');
    char path[PATH_MAX_CHARS], *rest = path;
    bool remove = !equals; /* --unset */
    if (remove) equals = text + strlen(text);
    if (equals == text || (size_t)(equals - text) >= sizeof path)
        return app_host_bad(&r->scene->host, "--set", 0,
                            "'%s' is not PATH=VALUE; write for example --set tissue.force=plain", text);
    memcpy(path, text, (size_t)(equals - text));
    path[equals - text] = 0;
    int at = 1, value = parse_set_value(r, remove ? "" : equals + 1, set);
    tm_status rc = TM_OK;
    if (!value) return app_scene_bad(r->scene, line_of_set(set), "the value is not YAML; quote it or correct it");
    while (*rest && !rc)
        rc = *rest == '[' ? enter_item(r, set, value, &rest, &at) : enter_key(r, set, value, remove, &rest, &at);
    return rc;
}
