/* Parses an LCM URL. */
#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>

#include "receiver.h"

static bool option(app_udpm_url *url, const char *name, size_t name_size, const char *text, const char *end) {
    char *stop;
    const long value = strtol(text, &stop, 10);
    if (stop == text || stop != end || value < 0 || value > 1 << 30) return false;
    if (name_size == 3 && memcmp(name, "ttl", 3) == 0) {
        url->ttl = (int)value;
        return value < 256;
    }
    if (name_size == 13 && memcmp(name, "recv_buf_size", 13) == 0) url->recv_buf_size = (int)value;
    return true;
}

bool app_udpm_parse(const char *url, app_udpm_url *parsed) {
    static const char scheme[] = "udpm://";
    char host[64];
    if (strncmp(url, scheme, sizeof scheme - 1) != 0) return false;
    const char *at = url + sizeof scheme - 1;
    const size_t length = strcspn(at, "?"), name = strcspn(at, ":?");
    *parsed = (app_udpm_url){.group = inet_addr("239.255.76.67"), .port = 7667};
    if (name >= sizeof host) return false;
    memcpy(host, at, name);
    host[name] = 0;
    if (name > 0 && inet_pton(AF_INET, host, &parsed->group) != 1) return false;
    if (name < length) {
        char *end;
        const long port = strtol(at + name + 1, &end, 10);
        if (end != at + length || port < 1 || port > 65535) return false;
        parsed->port = (uint16_t)port;
    }
    at += length;
    while (*at) { /* at '?' or '&' */
        at++;
        const size_t pair = strcspn(at, "&"), key = strcspn(at, "=&");
        if (key >= pair || !option(parsed, at, key, at + key + 1, at + pair)) return false;
        at += pair;
    }
    return IN_MULTICAST(ntohl(parsed->group));
}

bool app_url_leaves(const char *url) {
    static const char *const stays[] = {"memq:", "file:", "tcpq://127.", "tcpq://localhost", "tcpq://:", "tcpq://?"};
    app_udpm_url parsed;
    if (strncmp(url, "udpm:", 5) == 0) return !app_udpm_parse(url, &parsed) || parsed.ttl > 0;
    for (size_t i = 0; i < sizeof stays / sizeof *stays; i++)
        if (strncmp(url, stays[i], strlen(stays[i])) == 0) return false;
    return strcmp(url, "tcpq://") != 0;
}
