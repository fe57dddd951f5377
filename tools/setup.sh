#!/bin/bash
# Installs the Debian packages that a target needs, if they are missing.
#   tools/setup.sh GROUP...      groups are the files of tools/packages/ (without .txt)
#   tools/setup.sh venv DIR      the Python environment of tests and plots
# Exit 2, with the command to type, if it cannot or may not install.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)

if [ "${1:-}" = venv ]; then
    dir=$2
    [ -e "$dir/.done" ] && [ "$dir/.done" -nt "$here/requirements.txt" ] && exit 0
    echo "setup: Python environment in $dir"
    /usr/bin/python3 -m venv "$dir" || { echo "setup: /usr/bin/python3 -m venv failed; apt-get install python3-venv" >&2; exit 2; }
    "$dir/bin/pip" install -q --disable-pip-version-check -r "$here/requirements.txt" ||
        { echo "setup: pip could not install $(grep -vc '^$' "$here/requirements.txt") packages of tools/requirements.txt; check the network or the package index, then run the same command again" >&2; exit 2; }
    touch "$dir/.done"
    exit 0
fi

wanted=()
for group in "$@"; do
    [ -f "$here/packages/$group.txt" ] || { echo "setup: no group '$group' in tools/packages; use one of: $(ls "$here/packages" | sed 's/\.txt//' | tr '\n' ' ')" >&2; exit 2; }
    mapfile -t -O "${#wanted[@]}" wanted < <(grep -v -e '^#' -e '^$' "$here/packages/$group.txt")
done
missing=()
for package in "${wanted[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

command -v apt-get >/dev/null || { echo "setup: no apt-get here; install the equivalents of: ${missing[*]}" >&2; exit 2; }
sudo=
if [ "$(id -u)" != 0 ]; then
    if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo=sudo; else
        printf 'setup: %d packages are missing and this user may not install them; type\n  sudo apt-get install --no-install-recommends %s\n' "${#missing[@]}" "${missing[*]}" >&2
        exit 2
    fi
fi
echo "setup: installing ${#missing[@]} packages: ${missing[*]}"
log=$(mktemp)
install() { $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}" >"$log" 2>&1; }
install || { $sudo apt-get update -q >>"$log" 2>&1 || true; install; } || {
    tail -n 5 "$log" >&2
    printf 'setup: could not install; missing: %s\nsetup: the log is %s; check the network, then type\n  sudo apt-get install --no-install-recommends %s\n' "${missing[*]}" "$log" "${missing[*]}" >&2
    exit 2
}
rm -f "$log"
