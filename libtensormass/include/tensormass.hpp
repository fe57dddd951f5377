/* C++17 interface of libtensormass: owning handles, exceptions for set-up, spans for arrays. Header-only, on the same C
 * library.
 *
 * A `_ref` is the C pointer only, passed in a register; its functions are the C calls. An owner is a `_ref` that
 * destroys. Units, shapes and errors are those of the C functions of the same names: this header documents differences
 * only. Set-up throws tensormass::error. Steps throw nothing and return tm_status (without `noexcept`, which would add
 * handlers to the caller's code). The order of destruction is the caller's, as in C: declare mesh, tissue, world, and
 * they are destroyed in reverse. (`namespace tm` is impossible: the C library has a struct of that name.) */
#ifndef TENSORMASS_HPP
#define TENSORMASS_HPP

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "tensormass.h"

namespace tensormass {

/* Pointer and count. C++17 lacks std::span; where it exists, this converts to it. */
template <class T> class span {
  public:
    using element_type = T;
    using value_type = std::remove_cv_t<T>;
    constexpr span() noexcept = default;
    constexpr span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    template <std::size_t N> constexpr span(T (&array)[N]) noexcept : data_(array), size_(N) {}
    /* From anything with data() and size() of this type: vector, array, another span. */
    template <class C, class = std::enable_if_t<std::is_convertible_v<
                           std::remove_pointer_t<decltype(std::declval<C &>().data())> (*)[], T (*)[]>>>
    constexpr span(C &&from) noexcept : data_(from.data()), size_(from.size()) {}
    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }
    constexpr T &operator[](std::size_t i) const noexcept { return data_[i]; }
    constexpr span subspan(std::size_t from, std::size_t count) const noexcept { return {data_ + from, count}; }

  private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

/* A failed set-up, with the library's message. */
class error : public std::runtime_error {
  public:
    explicit error(const tm_error &from)
        : std::runtime_error(from.message), status_(from.status), entity_(from.entity) {}
    tm_status status() const noexcept { return status_; }
    std::int64_t entity() const noexcept { return entity_; } /* vertex, tetrahedron ... to blame, -1: none */

  private:
    tm_status status_;
    std::int64_t entity_;
};

/* check([&](tm_error *e) { return tm_stage_gravity(world.get(), g, e); }): for functions without a wrapper here. */
template <class F> void check(F &&call) {
    tm_error why{};
    why.entity = -1;
    const tm_status status = call(&why);
    if (status == TM_OK) return;
    why.status = status;
    if (!why.message[0])
        throw error([&] {
            tm_error named = why;
            std::string(tm_status_name(status)).copy(named.message, sizeof named.message - 1);
            return named;
        }());
    throw error(why);
}

/* Owner of a C pointer: moved, never copied. `Ref` has a protected `p_` of type T *. */
template <class Ref, class T, void (*Destroy)(T *)> class owner : public Ref {
  public:
    owner() noexcept = default;
    explicit owner(T *taken) noexcept { this->p_ = taken; }
    owner(owner &&from) noexcept { this->p_ = from.release(); }
    owner &operator=(owner &&from) noexcept {
        if (this != &from) reset(from.release());
        return *this;
    }
    owner(const owner &) = delete;
    owner &operator=(const owner &) = delete;
    ~owner() { reset(); }
    T *release() noexcept { return std::exchange(this->p_, nullptr); }
    void reset(T *taken = nullptr) noexcept {
        if (T *old = std::exchange(this->p_, taken)) Destroy(old);
    }
};

template <class T> class reference {
  public:
    constexpr reference() noexcept = default;
    constexpr reference(T *of) noexcept : p_(of) {}
    constexpr T *get() const noexcept { return p_; }
    constexpr explicit operator bool() const noexcept { return p_ != nullptr; }

  protected:
    T *p_ = nullptr;
};

/* --- mesh --- */

class mesh_ref : public reference<const tm_mesh> {
  public:
    using reference::reference;
    const tm_mesh *operator->() const noexcept { return p_; }
    span<const double> rest_m() const noexcept { return {p_->rest_m, 3 * std::size_t(p_->vertex_count)}; }
    span<const std::int32_t> tet() const noexcept { return {p_->tet, 4 * std::size_t(p_->tet_count)}; }
    span<const std::int32_t> region() const noexcept { return {p_->region, std::size_t(p_->tet_count)}; }
    span<const std::int32_t> surface() const noexcept { return {p_->surface, 3 * std::size_t(p_->surface_count)}; }
    /* Original number of each vertex; empty: not renumbered. */
    span<const std::int32_t> original_vertex() const noexcept {
        return {p_->original_vertex, p_->original_vertex ? std::size_t(p_->vertex_count) : 0};
    }
};

class mesh : public mesh_ref {
  public:
    mesh() noexcept = default;
    explicit mesh(tm_mesh *taken) noexcept : mesh_ref(taken), own_(taken) {}
    explicit mesh(const tm_mesh_def &def) {
        check([&](tm_error *e) { return tm_mesh_create(&def, &own_, e); });
        p_ = own_;
    }
    /* [3*vertices] m, [4*tetrahedra], [tetrahedra] or empty: one region. Copied. */
    mesh(span<const double> vertex_m, span<const std::int32_t> tet, span<const std::int32_t> region = {},
         tm_numbering renumber = TM_NUMBERING_ORIGINAL)
        : mesh(define(vertex_m, tet, region, renumber)) {}
    mesh(mesh &&from) noexcept { swap(from); }
    mesh &operator=(mesh &&from) noexcept {
        swap(from);
        return *this;
    }
    ~mesh() { tm_mesh_destroy(own_); }

  private:
    static tm_mesh_def define(span<const double> vertex_m, span<const std::int32_t> tet,
                              span<const std::int32_t> region, tm_numbering renumber) {
        tm_mesh_def def = tm_mesh_def_default();
        def.renumber = renumber;
        def.vertex_count = std::int32_t(vertex_m.size() / 3), def.vertex_m = vertex_m.data();
        def.tet_count = std::int32_t(tet.size() / 4), def.tet = tet.data();
        if (!region.empty() && region.size() != tet.size() / 4)
            throw std::invalid_argument("region: one a tetrahedron");
        def.region = region.empty() ? nullptr : region.data();
        return def;
    }
    void swap(mesh &from) noexcept {
        std::swap(p_, from.p_);
        std::swap(own_, from.own_);
    }
    tm_mesh *own_ = nullptr;
};

/* --- material and tissue --- */

inline tm_material young(double young_Pa, double poisson, double density_kg_m3, double damping_1_s = 0) {
    tm_material made;
    check([&](tm_error *e) { return tm_material_young(young_Pa, poisson, &made, e); });
    made.density_kg_m3 = density_kg_m3, made.damping_1_s = damping_1_s;
    return made;
}

class tissue_ref : public reference<tm_tissue> {
  public:
    using reference::reference;
    mesh_ref mesh() const { return tm_tissue_mesh(p_); }
    span<const double> mass_kg() const { return {tm_tissue_mass_kg(p_), std::size_t(mesh()->vertex_count)}; }
    span<const std::uint8_t> alive() const { return {tm_tissue_alive(p_), std::size_t(mesh()->tet_count)}; }
    std::int32_t alive_count() const { return tm_tissue_alive_count(p_); }
    tm_surface_view surface() const { return tm_tissue_surface(p_); }
    /* u_m, force_N: [3*vertices] */
    void force(span<const double> u_m, span<double> force_N) const { tm_tissue_force(p_, u_m.data(), force_N.data()); }
    double energy(span<const double> u_m) const { return tm_tissue_energy(p_, u_m.data()); }
    double critical_step_s() const { return tm_critical_step_guaranteed(p_, nullptr); }
};

class tissue : public owner<tissue_ref, tm_tissue, tm_tissue_destroy> {
  public:
    using owner::owner;
    explicit tissue(const tm_tissue_def &def) {
        check([&](tm_error *e) { return tm_tissue_create(&def, &p_, e); });
    }
    /* Region i of the mesh has material i. */
    tissue(mesh_ref of, span<const tm_material> material) {
        tm_tissue_def def = tm_tissue_def_default();
        def.mesh = of.get(), def.material_count = std::int32_t(material.size()), def.material = material.data();
        check([&](tm_error *e) { return tm_tissue_create(&def, &p_, e); });
    }
    /* One material for all regions. */
    tissue(mesh_ref of, const tm_material &material) {
        const std::vector<std::int32_t> first(std::size_t(of->region_count));
        tm_tissue_def def = tm_tissue_def_default();
        def.mesh = of.get(), def.material_count = 1, def.material = &material, def.region_material = first.data();
        check([&](tm_error *e) { return tm_tissue_create(&def, &p_, e); });
    }
};

/* --- world --- */

/* The handle of the stage "contact", which its world owns. */
class contact_ref : public reference<tm_contact> {
  public:
    using reference::reference;
    void begin_frame(std::int32_t substeps, std::int32_t average) const {
        tm_contact_begin_frame(p_, substeps, average);
    }
    void set_target(std::int32_t instrument, const tm_tool_pose &to, std::int32_t substeps) const {
        tm_contact_set_target(p_, instrument, &to, substeps);
    }
    void set_pose(std::int32_t instrument, const tm_tool_pose &at) const { tm_contact_set_pose(p_, instrument, &at); }
    tm_tool_pose pose(std::int32_t instrument) const { return tm_contact_pose(p_, instrument); }
    tm_tool_reaction reaction(std::int32_t instrument) const { return tm_contact_reaction(p_, instrument); }
};

/* The handle of the stage "touch", contact of tissue with tissue, which its world owns. */
class touching_ref : public reference<tm_touching> {
  public:
    using reference::reference;
    /* Rows of the last substep; valid until the next. */
    span<const tm_touching_row> rows() const {
        const tm_touching_row *row = nullptr;
        const std::int32_t count = tm_touching_rows(p_, &row);
        return {row, std::size_t(count)};
    }
    tm_touching_report report() const { return tm_touching_get_report(p_); }
};

/* The handle of the stage "ties", which its world owns. */
class ties_ref : public reference<tm_ties> {
  public:
    using reference::reference;
    std::int32_t count() const { return tm_ties_count(p_); }
    bool is_whole(std::int32_t tie) const { return tm_ties_is_whole(p_, tie); }
    double force_N(std::int32_t tie) const { return tm_ties_force_N(p_, tie, nullptr, nullptr); }
    tm_tie tie(std::int32_t number) const { return tm_ties_get(p_, number); } /* as it was added */
    /* Where a tie begins and ends now, m. */
    std::array<std::array<double, 3>, 2> ends_m(std::int32_t tie) const {
        std::array<std::array<double, 3>, 2> ends{};
        tm_ties_force_N(p_, tie, ends[0].data(), ends[1].data());
        return ends;
    }
    /* Writes the ties that went since the last call, as many as fit, and why each went (empty: unwanted). Returns their
     * number. */
    std::int32_t fetch_cut(span<std::int32_t> tie, span<std::int32_t> why = {}) const {
        if (!why.empty() && why.size() < tie.size()) throw std::invalid_argument("why: one a tie, or none");
        return tm_ties_fetch_cut(p_, tie.data(), why.empty() ? nullptr : why.data(), std::int32_t(tie.size()));
    }
};

class world_ref : public reference<tm_world> {
  public:
    using reference::reference;
    /* Succeeds completely or changes nothing; no exception, no allocation. */
    [[nodiscard]] tm_status step(std::int32_t count = 1) const { return tm_world_step(p_, count); }
    /* The integrator rotates the three arrays: get them again after a step. */
    span<double> u_m() const { return array(tm_world_state(p_)->u_m); }
    span<double> u_prev_m() const { return array(tm_world_state(p_)->u_prev_m); }
    span<double> u_next_m() const { return array(tm_world_state(p_)->u_next_m); }
    span<double> force_N() const { return array(tm_world_state(p_)->force_N); }
    double time_s() const { return tm_world_state(p_)->time_s; }
    double step_s() const { return tm_world_step_s(p_); }
    tissue_ref tissue() const { return tm_world_tissue(p_); }
    std::uint64_t hash() const { return tm_world_hash(p_); }

    void add_gravity(const std::array<double, 3> &g_m_s2) const {
        check([&](tm_error *e) { return tm_stage_gravity(p_, g_m_s2.data(), e); });
    }
    void add_load(span<const double> force_N) const { /* [3*vertices] */
        check([&](tm_error *e) { return tm_stage_load(p_, force_N.data(), e); });
    }
    void add_pressure(span<const double> pressure_Pa) const { /* [surface triangles]; follows the deformed surface */
        if (pressure_Pa.size() != std::size_t(tm_tissue_mesh(tm_world_tissue(p_))->surface_count))
            throw std::invalid_argument("pressure_Pa: one a triangle of the mesh's surface");
        check([&](tm_error *e) { return tm_stage_pressure(p_, pressure_Pa.data(), e); });
    }
    /* u[dof[i]] = value_m[i], dof = 3*vertex + axis; empty: all 0. */
    void add_support(span<const std::int32_t> dof, span<const double> value_m = {}) const {
        std::vector<double> zero(value_m.empty() ? dof.size() : 0);
        if (!value_m.empty() && value_m.size() != dof.size()) throw std::invalid_argument("value_m: one a component");
        tm_support_def def = tm_support_def_default();
        def.count = std::int32_t(dof.size()), def.dof = dof.data();
        def.value_m = value_m.empty() ? zero.data() : value_m.data();
        check([&](tm_error *e) { return tm_stage_support(p_, &def, e); });
    }
    contact_ref add_contact(const tm_contact_def &def) const {
        tm_contact *made = nullptr;
        check([&](tm_error *e) { return tm_stage_contact(p_, &def, &made, e); });
        return made;
    }
    contact_ref add_contact(span<const tm_instrument_def> instrument) const {
        tm_contact_def def = tm_contact_def_default();
        def.instrument_count = std::int32_t(instrument.size()), def.instrument = instrument.data();
        return add_contact(def);
    }
    void add_cut(contact_ref contact, const tm_cut_def &def = tm_cut_def_default()) const {
        check([&](tm_error *e) { return tm_stage_cut(p_, contact.get(), &def, e); });
    }
    touching_ref add_touch(const tm_touching_def &def = tm_touching_def_default()) const {
        tm_touching *made = nullptr;
        check([&](tm_error *e) { return tm_stage_touch(p_, &def, &made, e); });
        return made;
    }
    ties_ref add_ties(span<const tm_tie> tie) const {
        tm_ties_def def = tm_ties_def_default();
        def.count = std::int32_t(tie.size()), def.tie = tie.data();
        tm_ties *made = nullptr;
        check([&](tm_error *e) { return tm_stage_ties(p_, &def, &made, e); });
        return made;
    }
    /* Null: the world has no such stage. */
    touching_ref touch() const { return tm_world_touching(p_); }
    ties_ref ties() const { return tm_world_ties(p_); }
    /* `run(world_ref)`, which may not throw, once a substep; the world keeps it. */
    template <class F> void add_stage(const char *name, tm_phase phase, F run) const {
        static_assert(std::is_nothrow_invocable_v<F &, world_ref>,
                      "a stage runs inside a C function: make it noexcept");
        tm_stage stage{};
        stage.size = sizeof stage, stage.name = name, stage.phase = phase;
        stage.run = [](void *self, tm_world *world) { (*static_cast<F *>(self))(world_ref(world)); };
        stage.destroy = [](void *self) { delete static_cast<F *>(self); };
        F *kept = new F(std::move(run));
        stage.self = kept;
        try {
            check([&](tm_error *e) { return tm_world_add_stage(p_, &stage, sizeof(F), e); });
        } catch (...) {
            delete kept;
            throw;
        }
    }
    void remove_stage(const char *name) const {
        check([&](tm_error *e) { return tm_world_remove_stage(p_, name, e); });
    }
    tm_settle_result settle(const tm_settle_def &def = tm_settle_def_default()) const {
        tm_settle_result result{};
        check([&](tm_error *e) { return tm_world_settle(p_, &def, &result, e); });
        return result;
    }
    /* Doubles, for alignment. */
    std::vector<double> snapshot() const {
        std::vector<double> kept((std::size_t(tm_snapshot_bytes(p_)) + 7) / 8);
        check([&](tm_error *e) { return tm_snapshot_save(p_, kept.data(), tm_snapshot_bytes(p_), e); });
        return kept;
    }
    /* Upper bound of any later snapshot of the world's present stages. */
    std::int64_t snapshot_bytes_max() const { return tm_snapshot_bytes_max(p_); }
    /* Uses the size of the snapshot, not the world's present size. */
    void restore(span<const double> snapshot) const {
        const std::int64_t bytes = std::int64_t(8 * snapshot.size());
        check([&](tm_error *e) { return tm_snapshot_restore(p_, snapshot.data(), bytes, e); });
    }

  private:
    span<double> array(double *of) const {
        return {of, 3 * std::size_t(tm_tissue_mesh(tm_world_tissue(p_))->vertex_count)};
    }
};

class world : public owner<world_ref, tm_world, tm_world_destroy> {
  public:
    using owner::owner;
    explicit world(const tm_world_def &def) {
        check([&](tm_error *e) { return tm_world_create(&def, &p_, e); });
    }
    /* The tissue must outlive it. */
    explicit world(tissue_ref of) {
        tm_world_def def = tm_world_def_default();
        def.tissue = of.get();
        check([&](tm_error *e) { return tm_world_create(&def, &p_, e); });
    }
};

/* --- models --- */

class model_ref : public reference<tm_model> {
  public:
    using reference::reference;
    const tm_model *operator->() const noexcept { return p_; }
    [[nodiscard]] tm_status frame(span<const tm_tool_pose> to = {}) const { return tm_model_frame(p_, to.data()); }
    tm_tool_reaction reaction(std::int32_t instrument) const { return tm_model_reaction(p_, instrument); }
    tm_surface_view surface() const { return tm_model_surface(p_); }
    span<const double> u_m() const {
        return {tm_model_displacement(p_), 3 * std::size_t(tm_tissue_mesh(p_->tissue)->vertex_count)};
    }
    double time_s() const { return tm_model_time_s(p_); }
    world_ref world() const noexcept { return p_->world; } /* false: quasi-static, no steps */
};

/* model(tm_model_dynamic, def), and with tensormass_solve.h
 * model([&](auto... at) { return tm_model_hybrid(&def, &how, at...); }) wherever a constructor ends in
 * (tm_model **, tm_error *). */
class model : public owner<model_ref, tm_model, tm_model_destroy> {
  public:
    using owner::owner;
    explicit model(const tm_model_def &def) {
        check([&](tm_error *e) { return tm_model_dynamic(&def, &p_, e); });
    }
    template <class F, class = std::enable_if_t<std::is_invocable_r_v<tm_status, F &, tm_model **, tm_error *>>>
    explicit model(F make) {
        check([&](tm_error *e) { return make(&p_, e); });
    }
};

} // namespace tensormass

#endif
