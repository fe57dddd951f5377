/* libtensormass_scene for C++17 (tensormass.hpp): a scene that closes itself; its faults are thrown as one
 * exception. */
#ifndef TENSORMASS_SCENE_HPP
#define TENSORMASS_SCENE_HPP

#include "tensormass.hpp"
#include "tensormass_scene.h"

#include <memory>

namespace tensormass {

class scene_ref : public reference<tm_scene> {
  public:
    using reference::reference;
    tm_scene_info about() const { return tm_scene_get_info(p_); }
    /* Computes one frame: along the scene's hands, or to the given poses, one per instrument (fewer:
     * TM_ERR_ARGUMENT). */
    [[nodiscard]] tm_status step() const { return tm_scene_step(p_, nullptr); }
    [[nodiscard]] tm_status step(span<const tm_tool_pose> to) const {
        const bool enough = to.size() >= std::size_t(tm_scene_get_info(p_).instrument_count);
        return enough ? tm_scene_step(p_, to.data()) : TM_ERR_ARGUMENT;
    }
    mesh_ref mesh() const { return tm_scene_mesh(p_); }
    tissue_ref tissue() const { return tm_scene_tissue(p_); }
    world_ref world() const { return tm_scene_world(p_); } /* empty for the precomputed model */
    span<const double> u_m() const {
        return {tm_scene_displacement(p_), 3 * std::size_t(tm_scene_get_info(p_).vertex_count)};
    }
    tm_surface_view surface() const { return tm_scene_surface(p_); }
    tm_tool_reaction reaction(std::int32_t instrument = 0) const { return tm_scene_reaction(p_, instrument); }
    tm_tool_pose pose(std::int32_t instrument = 0) const { return tm_scene_pose(p_, instrument); }
    std::uint64_t hash() const { return tm_scene_hash(p_); }
};

class scene : public owner<scene_ref, tm_scene, tm_scene_close> {
  public:
    /* `set`: "path=value" or "path". Throws an error with the first fault as its message, after file and line. */
    explicit scene(const std::string &file, const std::vector<std::string> &set = {})
        : list_(new tm_diagnostics{}, [](tm_diagnostics *list) {
              tm_diagnostics_clear(list);
              delete list;
          }) {
        std::vector<const char *> lines;
        for (const std::string &line : set) lines.push_back(line.c_str());
        tm_scene_def def = tm_scene_def_default();
        def.file = file.c_str();
        def.set = lines.data();
        def.set_count = std::int32_t(lines.size());
        def.diagnostics = list_.get();
        check([&](tm_error *e) {
            const tm_status status = tm_scene_open(&def, &p_);
            for (const tm_diagnostic &d : diagnostics())
                if (d.severity == TM_FAULT && !e->message[0]) tm_diagnostic_format(&d, e->message, sizeof e->message);
            return status;
        });
    }
    /* Returns the warnings and remarks so far. */
    span<const tm_diagnostic> diagnostics() const { return {list_->item, std::size_t(list_->count)}; }

  private:
    std::unique_ptr<tm_diagnostics, void (*)(tm_diagnostics *)> list_; /* keeps its address when the scene moves */
};

} // namespace tensormass

#endif
