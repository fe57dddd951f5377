/* One key of a list's item in a scene's text, put in or left out: "supports[1].vertex". The item may be a mapping in
 * braces over many lines, or lines of its own. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study_yaml.h"

/* Where the value at `c` of a mapping in braces ends: at its comma or brace. Null: nowhere. */
static char *flow_end(char *c) {
    int depth = 0;
    char quote = 0;
    for (; *c; c++) {
        if (quote) {
            if (*c == quote) quote = 0;
        } else if (*c == '"' || *c == '\'')
            quote = *c;
        else if (*c == '#' && (c[-1] == ' ' || c[-1] == '\n')) {
            c += strcspn(c, "\n");
            if (!*c) return NULL;
        } else if (*c == '{' || *c == '[')
            depth++;
        else if (depth == 0 && (*c == ',' || *c == '}'))
            return c;
        else if (*c == '}' || *c == ']')
            depth--;
    }
    return NULL;
}

static bool is_word(const char *text, const char *key) {
    return !strncmp(text, key, strlen(key)) && text[strlen(key)] == ':';
}

static void take_out(char *from, const char *to) { memmove(from, to, strlen(to) + 1); }

static void put_in(char *at, const char *words) {
    memmove(at + strlen(words), at, strlen(at) + 1);
    memcpy(at, words, strlen(words));
}

/* `item` begins with its brace. */
static bool change_flow(char *item, const char *key, const char *value) {
    char words[400];
    snprintf(words, sizeof words, "%s: %s, ", key, value ? value : "");
    if (value) {
        put_in(item + 1, words);
        return true;
    }
    for (char *c = item; c && (c == item || *c == ',');) {
        char *word = c + 1 + strspn(c + 1, " \n"), *end = flow_end(word);
        if (end && is_word(word, key)) {
            if (*end == ',')
                take_out(word, end + 1 + strspn(end + 1, " \n"));
            else
                take_out(c == item ? word : c, end);
            return true;
        }
        c = end;
    }
    return false;
}

/* `item` is the text after its dash, `column` where that begins. */
static bool change_block(char *item, size_t column, const char *key, const char *value) {
    char words[400];
    snprintf(words, sizeof words, "%s: %s\n%*s", key, value ? value : "", (int)column, "");
    if (value) {
        put_in(item, words);
        return true;
    }
    for (char *word = item; word;) {
        char *next = strchr(word, '\n');
        while (next && strspn(next + 1, " ") > column) next = strchr(next + 1, '\n'); /* what belongs to it */
        if (is_word(word, key)) {
            if (next)
                take_out(word, next + 1 + strspn(next + 1, " "));
            else
                *(word > item ? word - 1 - column : word) = 0;
            return true;
        }
        word = next && strspn(next + 1, " ") == column ? next + 1 + column : NULL;
    }
    return false;
}

bool study_yaml_item(char *text, const char *list, int number, const char *key, const char *value) {
    char head[80];
    snprintf(head, sizeof head, "\n%s:", list);
    char *at = strstr(text, head);
    size_t dash = 0;
    for (at = at ? strchr(at + 1, '\n') : NULL; at; at = strchr(at + 1, '\n')) {
        const size_t indent = strspn(at + 1, " ");
        if (at[1 + indent] == '\n' || at[1 + indent] == '#' || !at[1 + indent]) continue;
        if (indent == 0 && at[1] != '-') return false; /* the next section */
        if (at[1 + indent] != '-' || (dash && indent + 1 != dash)) continue;
        dash = indent + 1;
        if (number-- > 0) continue;
        char *item = at + 1 + dash;
        const size_t column = dash + strspn(item, " ");
        item += strspn(item, " ");
        return *item == '{' ? change_flow(item, key, value) : change_block(item, column, key, value);
    }
    return false;
}
