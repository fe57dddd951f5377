/* Numbers in columns: a header line of names, then rows, separated by commas; `#` begins a comment. */
#ifndef HRT_TABLE_H
#define HRT_TABLE_H

#include <stdbool.h>
#include <stdint.h>

enum { HRT_TABLE_FIELDS = 32 };
typedef struct hrt_table {
    int32_t fields, rows;
    char name[HRT_TABLE_FIELDS][32];
    double *value; /* [rows][fields] */
    int *line;     /* [rows] in the file */
} hrt_table;

/* False with a message on stderr, "file:line: what; what to do". */
bool hrt_table_read(const char *path, hrt_table *table);
void hrt_table_free(hrt_table *table);
/* Column of that name; -1. */
int32_t hrt_table_column(const hrt_table *table, const char *name);
/* The same, with a message on stderr when it is missing. */
bool hrt_table_need(const hrt_table *table, const char *path, const char *name, int32_t *column);

#endif
