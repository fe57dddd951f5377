/* libtensormass_io for C++17 (tensormass.hpp): a mesh file that frees itself, fibres as a vector. */
#ifndef TENSORMASS_IO_HPP
#define TENSORMASS_IO_HPP

#include "tensormass.hpp"
#include "tensormass_io.h"

namespace tensormass {

class mesh_file {
  public:
    /* `scale`: metres per unit of the file. */
    explicit mesh_file(const std::string &path, double scale = 1) {
        check([&](tm_error *e) { return tm_mesh_file_load(path.c_str(), scale, &file_, e); });
    }
    mesh_file(mesh_file &&from) noexcept : file_(std::exchange(from.file_, tm_mesh_file{})) {}
    mesh_file &operator=(mesh_file &&from) noexcept {
        std::swap(file_, from.file_);
        return *this;
    }
    ~mesh_file() { tm_mesh_file_free(&file_); }
    const tm_mesh_file *operator->() const noexcept { return &file_; }
    const tm_mesh_file *get() const noexcept { return &file_; }
    mesh build(tm_numbering renumber = TM_NUMBERING_ORIGINAL) const {
        tm_mesh *made = nullptr;
        check([&](tm_error *e) { return tm_mesh_file_build_numbered(&file_, renumber, &made, e); });
        return mesh(made);
    }
    /* Returns the vertices of a group by their numbers in the file, ascending; empty if there is no such group. */
    span<const std::int32_t> group(const std::string &name) const noexcept {
        for (std::int32_t g = 0; g < file_.group_count; g++)
            if (name == file_.group_name[g])
                return {file_.group_vertex + file_.group_begin[g],
                        std::size_t(file_.group_begin[g + 1] - file_.group_begin[g])};
        return {};
    }

  private:
    tm_mesh_file file_{};
};

/* Reads fibres: [3*tet_count] unit vectors. */
inline std::vector<double> fibres(const std::string &path, std::int32_t tet_count) {
    std::vector<double> fibre(3 * std::size_t(tet_count));
    check([&](tm_error *e) { return tm_fibres_load(path.c_str(), tet_count, fibre.data(), e); });
    return fibre;
}

} // namespace tensormass

#endif
