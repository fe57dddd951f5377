/* Readers of mesh files: .vtk if the bytes begin with '#', .mesh with 'M', .vtu with '<', else .msh. Each returns
 * either a message and no allocated memory, or a mesh with indices in range and distinct tags. A written copy reads
 * the same. */
#include "fuzz.h"
#include "libtensormass/numeric/order.h"
#include "tensormass_io.h"

static void all_different(const int64_t *tag, int64_t count) {
    int64_t *sorted = malloc((size_t)count * sizeof *sorted + 1);
    if (count) memcpy(sorted, tag, (size_t)count * sizeof *sorted);
    if (count > 1) qsort(sorted, (size_t)count, sizeof *sorted, num_ascending_int64);
    for (int64_t i = 1; i < count; i++) PROMISE(sorted[i] != sorted[i - 1]);
    free(sorted);
}

static void look_over(const tm_mesh_file *m) {
    PROMISE(m->tet_count > 0 && m->region_count > 0);
    for (int32_t i = 0; i < 4 * m->tet_count; i++) PROMISE(m->tet[i] >= 0 && m->tet[i] < m->vertex_count);
    for (int32_t t = 0; t < m->tet_count; t++) PROMISE(m->region[t] >= 0 && m->region[t] < m->region_count);
    PROMISE(m->group_begin[0] == 0);
    for (int32_t g = 0; g < m->group_count; g++) {
        PROMISE(m->group_begin[g] <= m->group_begin[g + 1] && memchr(m->group_name[g], 0, 64));
        for (int32_t i = m->group_begin[g]; i < m->group_begin[g + 1]; i++) {
            PROMISE(m->group_vertex[i] >= 0 && m->group_vertex[i] < m->vertex_count);
            PROMISE(i == m->group_begin[g] || m->group_vertex[i] > m->group_vertex[i - 1]);
        }
    }
    all_different(m->vertex_tag, m->vertex_count);
    all_different(m->tet_tag, m->tet_count);
}

/* Finite coordinates are reproduced bit for bit, and so are the corners. */
static void write_and_read(const tm_mesh_file *m, const char *ending) {
    char *text = NULL;
    size_t size = 0;
    tm_mesh_file back;
    tm_error error = {0};
    FILE *file = open_memstream(&text, &size);
    PROMISE(tm_mesh_file_write(m, ending, file, &error) == TM_OK);
    fclose(file);
    PROMISE(tm_mesh_file_parse(ending, text, size, 1, &back, &error) == TM_OK);
    PROMISE(back.vertex_count == m->vertex_count && back.tet_count == m->tet_count);
    PROMISE(memcmp(back.tet, m->tet, 4 * (size_t)m->tet_count * sizeof *m->tet) == 0);
    for (int32_t i = 0; i < 3 * m->vertex_count; i++)
        PROMISE(m->vertex_m[i] == back.vertex_m[i] || m->vertex_m[i] != m->vertex_m[i]);
    tm_mesh_file_free(&back);
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char first = (char)(size ? data[0] : 0);
    const char *ending = first == '#' ? ".vtk" : first == 'M' ? ".mesh" : first == '<' ? ".vtu" : ".msh";
    char *text = malloc(size + 1); /* exact size, so that a read beyond its end is detected */
    tm_mesh_file mesh;
    tm_error error = {0};
    if (size) memcpy(text, data, size);
    text[size] = 0;
    if (tm_mesh_file_parse(ending, text, size, 1, &mesh, &error) == TM_OK) {
        look_over(&mesh);
        if (strcmp(ending, ".msh") != 0)
            write_and_read(&mesh, ending); /* a name may contain characters that .msh cannot quote */
        tm_mesh_file_free(&mesh);
    } else
        PROMISE(error.message[0] && strchr(error.message, ';') && !mesh.vertex_m);
    free(text);
    return 0;
}
