// Makes tetrahedra of several materials with CGAL Mesh_3 (Delaunay refinement; Boissonnat and Oudot 2005, Boltcheva et
// al. 2009).
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/exude_mesh_3.h>
#include <CGAL/Labeled_mesh_domain_3.h>
#include <CGAL/lloyd_optimize_mesh_3.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/perturb_mesh_3.h>
#include <CGAL/refine_mesh_3.h>

#include <climits>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <unordered_map>

#include "box.h"
#include "module.h"

namespace {

typedef CGAL::Exact_predicates_inexact_constructions_kernel Kernel;
typedef CGAL::Labeled_mesh_domain_3<Kernel> Domain;
typedef CGAL::Mesh_triangulation_3<Domain>::type Triangulation;
typedef CGAL::Mesh_complex_3_in_triangulation_3<Triangulation> Complex;
typedef CGAL::Mesh_criteria_3<Triangulation> Criteria;
typedef Kernel::Point_3 Point;
namespace with = CGAL::parameters;

struct stopped {};

// Size requested at a point: of a tetrahedron its label's, of a facet the smaller of its two sides'.
struct field {
    typedef Kernel::FT FT;
    typedef Point Point_3;
    typedef Domain::Index Index;
    const double *of_label;
    double factor;
    FT one(int label) const { return label ? of_label[label] : HUGE_VAL; }
    FT operator()(const Point_3 &, int, const Index &index) const {
        if (const int *label = boost::get<int>(&index)) return factor * one(*label);
        const Domain::Surface_patch_index &sides = boost::get<Domain::Surface_patch_index>(index);
        return factor * std::min(one(sides.first), one(sides.second));
    }
};

// Returns labels; all queries pass here, so a stop takes effect here.
struct asker {
    const image_domain *domain;
    const image_request *request;
    const char *doing = "surface";
    const Triangulation *triangulation = nullptr;
    long asked = 0;
    int at(const Point &p) {
        if ((++asked & 0x3fff) == 0 && !request->go_on(request->go_on_context, doing,
                                                       triangulation ? int(triangulation->number_of_vertices()) : 0))
            throw stopped();
        const double place[3] = {p.x(), p.y(), p.z()};
        return domain->label(domain->context, place);
    }
};

// Returns the direction of ray i, evenly distributed on a spiral.
Kernel::Vector_3 ray(int i, int rays) {
    double z = 1 - (2 * i + 1) / double(rays), r = std::sqrt(1 - z * z), turn = i * 2.399963229728653;
    return Kernel::Vector_3(r * std::cos(turn), r * std::sin(turn), z);
}

// Adds initial points on every piece's surface: refinement finds no piece without an initial point.
void begin(const Domain &domain, const image_domain &body, const image_request &request, asker &ask, Complex &complex) {
    const int rays = 24;
    double reach = 0;
    for (int k = 0; k < 3; k++) reach += body.high_m[k] - body.low_m[k];
    for (int s = 0; s < body.seeds; s++) {
        const Point seed(body.seed_m[3 * s], body.seed_m[3 * s + 1], body.seed_m[3 * s + 2]);
        const int label = ask.at(seed);
        if (!label) continue;
        const double apart = 0.5 * request.edge_m[label];
        std::vector<Point> taken;
        for (int i = 0; i < rays; i++) {
            const Kernel::Vector_3 step = body.march_m * ray(i, rays);
            Point from = seed, to = seed + step;
            for (double gone = 0; ask.at(to) == label && gone < reach; gone += body.march_m) from = to, to = to + step;
            if (ask.at(to) == label) continue;
            const Domain::Intersection hit = domain.construct_intersection_object()(Kernel::Segment_3(from, to));
            if (std::get<2>(hit) != 2) continue;
            const Point p = std::get<0>(hit);
            bool near = false;
            for (const Point &q : taken)
                near = near || (taken.size() >= 6 && CGAL::squared_distance(p, q) < apart * apart);
            if (near) continue;
            taken.push_back(p);
            Triangulation::Vertex_handle v = complex.triangulation().insert(Triangulation::Weighted_point(p));
            if (v == Triangulation::Vertex_handle()) continue;
            complex.set_dimension(v, 2);
            complex.set_index(v, std::get<1>(hit));
        }
    }
}

// Returns the remaining tetrahedra, numbered in the triangulation's order, which is that of its construction.
bool give(const Complex &complex, image_tets *out) {
    std::unordered_map<const void *, int> number;
    out->vertex_m = (double *)malloc((3 * complex.triangulation().number_of_vertices() + 1) * sizeof(double));
    out->tet = (int *)malloc((4 * complex.number_of_cells_in_complex() + 1) * sizeof(int));
    out->label = (int *)malloc((complex.number_of_cells_in_complex() + 1) * sizeof(int));
    if (!out->vertex_m || !out->tet || !out->label) return false;
    for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell) {
        for (int k = 0; k < 4; k++) {
            const auto vertex = cell->vertex(k);
            const auto found = number.emplace((const void *)&*vertex, out->vertices);
            if (found.second) {
                const auto &p = vertex->point();
                double *to = out->vertex_m + 3 * (size_t)out->vertices++;
                to[0] = p.x(), to[1] = p.y(), to[2] = p.z();
            }
            out->tet[4 * (size_t)out->tets + k] = found.first->second;
        }
        out->label[out->tets++] = complex.subdomain_index(cell);
    }
    return true;
}

void optimise(Complex &complex, const Domain &domain, const image_request &request, asker &ask) {
    if (request.lloyd) {
        ask.doing = "lloyd";
        CGAL::lloyd_optimize_mesh_3(complex, domain, with::max_iteration_number = request.sweeps,
                                    with::convergence = 0.02, with::freeze_bound = 0.01);
    }
    // no time limits: the same image gives the same mesh
    if (request.perturb) {
        ask.doing = "perturb";
        CGAL::perturb_mesh_3(complex, domain, with::sliver_bound = request.sliver_deg);
    }
    if (request.exude) {
        ask.doing = "exude";
        CGAL::exude_mesh_3(complex, with::sliver_bound = request.sliver_deg);
    }
}

void work(const image_domain &body, const image_request &request, Complex &complex) {
    asker ask;
    ask.domain = &body;
    ask.request = &request;
    const Kernel::Iso_cuboid_3 box(body.low_m[0], body.low_m[1], body.low_m[2], body.high_m[0], body.high_m[1],
                                   body.high_m[2]);
    // relative to the box: the accuracy with which surfaces are located
    const Domain domain([&ask](const Point &p) { return ask.at(p); }, box, with::relative_error_bound = 2e-4);
    begin(domain, body, request, ask, complex);
    ask.triangulation = &complex.triangulation();
    // A regular tetrahedron of edge 1 has circumradius 0.61, its facets 0.58; the results reach 0.7 of the bound.
    const field cell{request.edge_m, 0.85}, facet{request.edge_m, 0.8}, distance{request.surface_m, 1};
    const Criteria criteria(with::facet_angle = request.facet_angle_deg, with::facet_size = facet,
                            with::facet_distance = distance, with::cell_radius_edge_ratio = request.radius_edge,
                            with::cell_size = cell);
    CGAL::refine_mesh_3(complex, domain, criteria, with::no_perturb(), with::no_exude());
    optimise(complex, domain, request, ask);
}

image_end mesh_here(const image_domain *domain, const image_request *request, image_tets *out, char *why) {
    try {
        Complex complex;
        work(*domain, *request, complex);
        if (!give(complex, out)) throw std::bad_alloc();
        return IMAGE_DONE;
    } catch (const stopped &) {
        return IMAGE_STOPPED;
    } catch (const std::bad_alloc &) {
        snprintf(why, IMAGE_WHY, "no memory for that many tetrahedra; choose a larger --size");
        return IMAGE_NO_MEMORY;
    } catch (const std::exception &e) {
        snprintf(why, IMAGE_WHY, "CGAL cannot mesh it: %.300s; choose another --size or --smooth", e.what());
        return IMAGE_FAILED;
    }
}

void put(box_pipe &to, const image_tets *t) {
    to.put(&t->vertices, sizeof t->vertices);
    to.put(&t->tets, sizeof t->tets);
    to.put(t->vertex_m, 3 * sizeof *t->vertex_m * size_t(t->vertices));
    to.put(t->tet, 4 * sizeof *t->tet * size_t(t->tets));
    to.put(t->label, sizeof *t->label * size_t(t->tets));
}

bool take(box_pipe &from, image_tets *t) {
    if (!from.take(&t->vertices, sizeof t->vertices) || !from.take(&t->tets, sizeof t->tets)) return false;
    t->vertex_m = (double *)from.take_array(3.0 * t->vertices, sizeof *t->vertex_m, 3.0 * INT_MAX);
    t->tet = (int *)from.take_array(4.0 * t->tets, sizeof *t->tet, 4.0 * INT_MAX);
    t->label = (int *)from.take_array(t->tets, sizeof *t->label, INT_MAX);
    if (t->vertex_m && t->tet && t->label) return true;
    free(t->vertex_m), free(t->tet), free(t->label);
    *t = image_tets();
    return false;
}

} // namespace

image_end image_mesh(const image_domain *domain, const image_request *request, image_tets *out, char why[IMAGE_WHY]) {
    *out = image_tets();
    return image_box(
        {"CGAL", 0, 0, false}, why, [=](char *said) { return mesh_here(domain, request, out, said); },
        [=](box_pipe &to) { put(to, out); }, [=](box_pipe &from) { return take(from, out); });
}
