/* Tables of numbers in CSV: a header line of names, then rows, separated by commas; `#` begins a comment. */
#ifndef HRT_TABLE_H
#define HRT_TABLE_H

#include <stdbool.h>
#include <stdint.h>

enum { HRT_TABLE_FIELDS = 32 };
typedef struct hrt_table {
    int32_t fields, rows;
    char name[HRT_TABLE_FIELDS][32];
    double *value; /* [rows][fields] */
    int *line;     /* [rows], line numbers in the file */
} hrt_table;

/* Reads a table. Returns false after a message "file:line: problem; remedy" on stderr. */
bool hrt_table_read(const char *path, hrt_table *table);
void hrt_table_free(hrt_table *table);
/* Returns the column of that name, -1 if there is none. */
int32_t hrt_table_column(const hrt_table *table, const char *name);
/* Finds a required column. Returns false after a message on stderr if it is missing. */
bool hrt_table_need(const hrt_table *table, const char *path, const char *name, int32_t *column);

#endif
