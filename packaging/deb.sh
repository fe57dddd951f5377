#!/bin/bash
# make deb: Debian packages of the present sources, in build/deb/.
#   packaging/deb.sh OUT VERSION SOVERSION
# The tools' package contains the installed files that are in no other package. Exit 1: the build failed; prints the end of its log.
set -euo pipefail
out=$(mkdir -p "$1/deb" && cd "$1/deb" && pwd) version=$2 soversion=$3
top=$(cd "$(dirname "$0")/.." && pwd)
tree=$out/tensormass-$version
rm -rf "$tree" "$out"/*.deb "$out"/*.changes "$out"/*.buildinfo
mkdir -p "$tree"
tar c -C "$top" --exclude=./build --exclude=.git --exclude=__pycache__ . | tar x -C "$tree"
cp -R "$top/packaging/debian" "$tree/debian"
cd "$tree/debian"
build=$(grep -hv -e '^#' -e '^$' -e python3-venv -e build-essential "$top/tools/packages/build.txt" | paste -sd, | sed 's/,/, /g')
sed -e "s/@SOVERSION@/$soversion/" -e "s/@BUILD@/$build/" control.in > control
sed -e "s/@VERSION@/$version/" -e "s/@DATE@/$(date -R -d "@${SOURCE_DATE_EPOCH:-$(stat -c %Y "$top/CHANGELOG.md")}")/" changelog.in > changelog
for part in libtensormass libtensormass-solve libtensormass-scene; do mv "$part.install.in" "$part$soversion.install"; done
sed "s/@SOVERSION@/$soversion/g" python3-tensormass.links.in > python3-tensormass.links
rm control.in changelog.in python3-tensormass.links.in
cat > tensormass-tools.install <<'TOOLS'
usr/bin
usr/lib/tensormass
usr/share/bash-completion
usr/share/doc/tensormass
usr/share/man
usr/share/tensormass
TOOLS
# Not by dh_install, which gives a file to every package that names it: other packages take files from these folders.
cat >> rules <<'RULES'
override_dh_install:
	dh_install --remaining-packages -Ntensormass-tools
	set -e; cd debian; for package in haptic-rt libtensormass-dev; do (cd $$package && find . ! -type d); done | sed 's|^\./||' > taken
	dh_install -ptensormass-tools
	cd debian/tensormass-tools && grep -v '^lib/' ../taken | xargs rm -f && find . -type d -empty -delete
RULES
cd "$tree"
DEB_BUILD_OPTIONS="parallel=$(nproc) noautodbgsym nocheck" dpkg-buildpackage -b -us -uc > "$out/build.log" 2>&1 || { tail -n 25 "$out/build.log" >&2; echo "make deb: failed; the log is $out/build.log" >&2; exit 1; }
rm -rf "$tree"
ls -l "$out"/*.deb
