// Reads triangle surfaces (OBJ, PLY, OFF, STL), finds holes and intersecting triangles, and repairs them if requested,
// with CGAL's Polygon Mesh Processing (GPL).
#include <CGAL/boost/graph/helpers.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_mesh_to_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/repair_self_intersections.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/stitch_borders.h>
#include <CGAL/Polygon_mesh_processing/triangulate_faces.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>

#include <climits>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <vector>

#include "box.h"
#include "look.h"
#include "module.h"
#include "refusal.h"

namespace {

typedef CGAL::Exact_predicates_inexact_constructions_kernel Kernel;
typedef Kernel::Point_3 Point;
typedef CGAL::Surface_mesh<Point> Mesh;
typedef Mesh::Halfedge_index Side;
namespace pmp = CGAL::Polygon_mesh_processing;

struct soup {
    std::vector<Point> points;
    std::vector<std::vector<std::size_t>> polygons;
};

// Checks a file's data: corners must exist, coordinates must be finite.
image_end check(const soup &s, char why[IMAGE_WHY]) {
    for (std::size_t v = 0; v < s.points.size(); v++)
        for (int k = 0; k < 3; k++)
            if (!std::isfinite(s.points[v][k])) {
                snprintf(why, IMAGE_WHY, "vertex %zu has a coordinate that is nan or infinite; save the surface again",
                         v + 1);
                return IMAGE_BAD_INPUT;
            }
    for (std::size_t f = 0; f < s.polygons.size(); f++)
        for (const std::size_t v : s.polygons[f])
            if (v >= s.points.size() || s.polygons[f].size() < 3) {
                snprintf(why, IMAGE_WHY,
                         "face %zu has fewer than three vertices, or one that does not exist; save the surface again",
                         f + 1);
                return IMAGE_BAD_INPUT;
            }
    if (s.polygons.size() > INT_MAX / 64 || s.points.size() > INT_MAX / 64) {
        snprintf(why, IMAGE_WHY, "it has too many faces, %zu; decimate the surface", s.polygons.size());
        return IMAGE_BAD_INPUT;
    }
    if (!s.polygons.empty()) return IMAGE_DONE;
    snprintf(why, IMAGE_WHY, "it has no faces; save the surface again");
    return IMAGE_BAD_INPUT;
}

void give(const std::vector<Point> &points, const std::vector<std::vector<std::size_t>> &triangles,
          image_surface *out) {
    double *corner = (double *)malloc((9 * triangles.size() + 1) * sizeof(double));
    if (!corner) throw std::bad_alloc();
    double *to = corner;
    for (const auto &triangle : triangles)
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) *to++ = points[triangle[c]][k];
    free(out->corner);
    out->corner = corner;
    out->triangles = int(triangles.size());
}

// Splits polygons with more than three corners into triangles, each separately, so that non-manifold surfaces can be
// read.
void triangulate(soup &s) {
    std::vector<std::vector<std::size_t>> triangles;
    for (const auto &polygon : s.polygons) {
        if (polygon.size() == 3) {
            triangles.push_back(polygon);
            continue;
        }
        std::vector<Point> ring;
        std::vector<CGAL::Triple<int, int, int>> pieces;
        for (const std::size_t v : polygon) ring.push_back(s.points[v]);
        pmp::triangulate_hole_polyline(ring, std::back_inserter(pieces),
                                       CGAL::parameters::use_delaunay_triangulation(true));
        for (const auto &t : pieces) triangles.push_back({polygon[t.first], polygon[t.second], polygon[t.third]});
    }
    s.polygons.swap(triangles);
}

// Makes a mesh of the triangles with consistent orientation; duplicates non-manifold vertices.
void make_mesh(const image_surface &in, Mesh &mesh) {
    soup s;
    for (int t = 0; t < in.triangles; t++) {
        const double *c = in.corner + 9 * (std::size_t)t;
        for (int k = 0; k < 3; k++) s.points.emplace_back(c[3 * k], c[3 * k + 1], c[3 * k + 2]);
        s.polygons.push_back({s.points.size() - 3, s.points.size() - 2, s.points.size() - 1});
    }
    pmp::repair_polygon_soup(s.points, s.polygons);
    pmp::orient_polygon_soup(s.points, s.polygons);
    pmp::polygon_soup_to_polygon_mesh(s.points, s.polygons, mesh);
}

void middle(const Mesh &mesh, Mesh::Face_index face, double at[3]) {
    for (int k = 0; k < 3; k++) at[k] = 0;
    for (const auto v : mesh.vertices_around_face(mesh.halfedge(face)))
        for (int k = 0; k < 3; k++) at[k] += mesh.point(v)[k] / 3;
}

void find(const Mesh &mesh, image_defects *out) {
    std::vector<Side> cycles;
    std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
    *out = image_defects();
    pmp::extract_boundary_cycles(mesh, std::back_inserter(cycles));
    for (const Side start : cycles) {
        int edges = 0;
        double sum[3] = {0, 0, 0};
        for (Side s = start; edges == 0 || s != start; s = mesh.next(s), edges++)
            for (int k = 0; k < 3; k++) sum[k] += mesh.point(mesh.target(s))[k];
        out->holes++;
        if (edges <= out->hole_edges) continue;
        out->hole_edges = edges;
        for (int k = 0; k < 3; k++) out->hole_at[k] = sum[k] / edges;
    }
    pmp::self_intersections<CGAL::Sequential_tag>(mesh, std::back_inserter(pairs));
    out->crossings = int(pairs.size());
    if (!pairs.empty()) middle(mesh, pairs[0].first, out->crossing_at);
}

void repair_mesh(Mesh &mesh) {
    pmp::stitch_borders(mesh);
    pmp::experimental::remove_self_intersections(mesh);
    std::vector<Side> cycles;
    pmp::extract_boundary_cycles(mesh, std::back_inserter(cycles));
    for (const Side start : cycles) {
        std::vector<Mesh::Face_index> faces;
        std::vector<Mesh::Vertex_index> vertices;
        if (mesh.is_border(start))
            pmp::triangulate_and_refine_hole(mesh, start, std::back_inserter(faces), std::back_inserter(vertices));
    }
    if (pmp::does_self_intersect(mesh)) pmp::experimental::remove_self_intersections(mesh);
}

template <class Work> image_end guarded(char why[IMAGE_WHY], Work work) {
    try {
        return work();
    } catch (const refusal &e) {
        snprintf(why, IMAGE_WHY, "%s", e.what());
        return IMAGE_BAD_INPUT;
    } catch (const std::bad_alloc &) {
        snprintf(why, IMAGE_WHY, "no memory for the surface; decimate it");
        return IMAGE_NO_MEMORY;
    } catch (const std::exception &e) {
        snprintf(why, IMAGE_WHY, "CGAL cannot process it: %.300s; repair it in MeshLab or Blender", e.what());
        return IMAGE_FAILED;
    }
}

void put(box_pipe &to, const image_surface *s) {
    to.put(&s->triangles, sizeof s->triangles);
    to.put(s->corner, 9 * sizeof(double) * std::size_t(s->triangles));
}

// Replaces the previous surface.
bool take(box_pipe &from, image_surface *s) {
    int triangles = 0;
    if (!from.take(&triangles, sizeof triangles)) return false;
    double *corner = (double *)from.take_array(9.0 * triangles, sizeof *corner, 9.0 * INT_MAX);
    if (!corner) return false;
    free(s->corner);
    s->corner = corner;
    s->triangles = triangles;
    return true;
}

image_end read_here(const char *path, image_surface *out, char *why) {
    return guarded(why, [&]() {
        soup s;
        if (!CGAL::IO::read_polygon_soup(path, s.points, s.polygons)) {
            snprintf(why, IMAGE_WHY, "it is not a surface of this type, or damaged or truncated; save it again");
            return IMAGE_BAD_INPUT;
        }
        const image_end end = check(s, why);
        if (end) return end;
        triangulate(s);
        give(s.points, s.polygons, out);
        return IMAGE_DONE;
    });
}

image_end examine_here(image_surface *surface, bool repair, image_defects *found, image_defects *left, char *why) {
    return guarded(why, [&]() {
        Mesh mesh;
        soup s;
        make_mesh(*surface, mesh);
        find(mesh, found);
        *left = *found;
        if (!repair) return IMAGE_DONE;
        repair_mesh(mesh);
        mesh.collect_garbage();
        find(mesh, left);
        pmp::polygon_mesh_to_polygon_soup(mesh, s.points, s.polygons);
        give(s.points, s.polygons, surface);
        return IMAGE_DONE;
    });
}

} // namespace

image_end image_read_surface(const char *path, image_surface *out, char why[IMAGE_WHY]) {
    *out = image_surface();
    double bytes = 0;
    const image_end looked = guarded(why, [&]() { return bytes = check_surface(path), IMAGE_DONE; });
    if (looked != IMAGE_DONE) return looked;
    return image_box(
        {"CGAL", 5 + std::ceil(bytes / 2e8), 6e8 + 10 * bytes, true}, why,
        [=](char *said) { return read_here(path, out, said); }, [=](box_pipe &to) { put(to, out); },
        [=](box_pipe &from) { return take(from, out); });
}

image_end image_examine_surface(image_surface *surface, bool repair, image_defects *found, image_defects *left,
                                char why[IMAGE_WHY]) {
    const double seconds = 5 + std::ceil(surface->triangles / (repair ? 500.0 : 5000.0));
    *found = *left = image_defects();
    return image_box(
        {"CGAL", seconds, 1e9 + 2e4 * surface->triangles, true}, why,
        [=](char *said) { return examine_here(surface, repair, found, left, said); },
        [=](box_pipe &to) {
            to.put(found, sizeof *found);
            to.put(left, sizeof *left);
            if (repair) put(to, surface);
        },
        [=](box_pipe &from) {
            return from.take(found, sizeof *found) && from.take(left, sizeof *left) && (!repair || take(from, surface));
        });
}
