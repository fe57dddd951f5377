#!/bin/bash
# make cross: core, tensormass_io and the controller's core for other machines, in build/cross/TARGET/ (libraries, archives, two test programs).
#   packaging/cross.sh OUT VERSION SOVERSION ZIG [TARGET...]      ZIG: the command, several words allowed
# Targets: x86_64-windows, aarch64-linux, aarch64-macos, x86_64-macos. Each is compiled by zig's clang with the flags of the Makefile.
set -euo pipefail
out=$1/cross version=$2 soversion=$3
read -ra zig <<< "$4"
shift 4
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- x86_64-windows aarch64-linux aarch64-macos x86_64-macos
flags=(-std=c11 -D_GNU_SOURCE -O3 -g0 -DNDEBUG -ffp-contract=off -fno-math-errno -fno-sanitize=undefined -w -I. -Ilibtensormass/include -Ilibtensormass/io/include -Ilibtensormass/src -Ihaptic_rt/core -Ihaptic_rt)

for target in "$@"; do
    case $target in
    *windows) triple=$target-gnu ending=dll name=%s.dll more=() program=.exe ;;
    *linux) triple=$target-gnu.2.28 ending=so name=%s.so.$version more=(-fPIC) program= ;; # Debian 10, manylinux_2_28
    *macos) triple=$target.11.0 ending=dylib name=%s.$version.dylib more=(-fPIC) program= ;;
    *) echo "cross: $target: no such target; see packaging/cross.sh" >&2; exit 2 ;;
    esac
    folder=$out/$target
    rm -rf "$folder" && mkdir -p "$folder/obj"
    jobs=()
    # library NAME VISIBILITY LINKS SOURCES...: an archive and a shared library.
    library() {
        local lib=$1 visibility=$2 links=$3 file soname objects=() source
        shift 3
        for source; do
            objects+=("$folder/obj/$lib-${source//\//_}.o")
        done
        printf '%s\n' "$@" | xargs -P "$(nproc)" -I{} bash -c 'o=$1/obj/$2-$(tr / _ <<< "$0").o; shift 2; exec "$@" -c "$0" -o "$o"' {} "$folder" "$lib" "${zig[@]}" cc -target "$triple" "${flags[@]}" "${more[@]}" "-fvisibility=$visibility"
        "${zig[@]}" ar rcs "$folder/$lib.a" "${objects[@]}"
        # shellcheck disable=SC2059
        file=$(printf "$name" "$lib")
        case $ending in
        so) soname=(-Wl,-soname,"$lib.so.$soversion" "-Wl,-rpath,\$ORIGIN") ;;
        dylib) soname=(-install_name "@rpath/$lib.$soversion.dylib" -Wl,-rpath,@loader_path) ;;
        dll) soname=("-Wl,--out-implib,$folder/$lib.dll.a") ;;
        esac
        # shellcheck disable=SC2086
        "${zig[@]}" cc -target "$triple" -shared -s "${soname[@]}" -o "$folder/$file" "${objects[@]}" $links -lm -lpthread
        [ $ending = dll ] || ln -sf "$file" "$folder/$lib.$ending"
        case $ending in so) ln -sf "$file" "$folder/$lib.so.$soversion" ;; dylib) ln -sf "$file" "$folder/$lib.$soversion.dylib" ;; esac
    }
    library libtensormass hidden "" libtensormass/src/*/*.c
    library libtensormass_io hidden "-L$folder -ltensormass" libtensormass/io/*.c
    library libtensormass_controller default "" haptic_rt/core/*.c
    for test in tests/cross/everywhere.c tests/hash/state_hash.c; do
        "${zig[@]}" cc -target "$triple" "${flags[@]}" $test -o "$folder/$(basename $test .c)$program" "$folder/libtensormass_io.a" "$folder/libtensormass.a" "$folder/libtensormass_controller.a" -lm -lpthread
    done
    rm -rf "$folder"/obj "$folder"/*.pdb
    echo "$target: $(cd "$folder" && ls | tr '\n' ' ')"
done
