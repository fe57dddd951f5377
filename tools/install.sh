#!/bin/bash
# Installs the files of a part, and removes them again.
#   DESTDIR= PREFIX= tools/install.sh put PART STAGE    STAGE/* to DESTDIR/*; a list of it to PREFIX/share/tensormass/installed/PART;
#                                                        STAGE is removed
#   DESTDIR= PREFIX= tools/install.sh remove            removes the listed files, then the folders that this leaves empty
# A list has one path a line, without DESTDIR: files and links, then the new folders, each with a / at its end. Files in an older list of the same
# part that are not in the new one are removed too, unless another part has them. Exit 2: nothing to remove.
set -euo pipefail
lists=$DESTDIR$PREFIX/share/tensormass/installed

listed_elsewhere() { # PATH PART: by the list of another part
    for other in "$lists"/*; do
        [ "$other" = "$lists/$2" ] || ! grep -qxF -- "$1" "$other" || return 0
    done
    return 1
}

put() {
    local part=$1 stage=$2 new old path folder
    new=$(mktemp) old=$(mktemp)
    trap 'rm -f "$new" "$old"' RETURN
    [ ! -f "$lists/$part" ] || cp "$lists/$part" "$old"
    # Lists the folders that this run makes, and those that an older list of the part already has.
    (cd "$stage" && find . -mindepth 1 -type d -printf '/%P/\n'; printf '%s/\n' "$PREFIX/share/tensormass" "$PREFIX/share/tensormass/installed") | sort -u |
        while read -r folder; do
            if [ ! -d "$DESTDIR$folder" ] || grep -qxF -- "$folder" "$old"; then echo "$folder"; fi
        done > "$new.folders"
    (cd "$stage" && find . -mindepth 1 ! -type d -printf '/%P\n') | sort > "$new"
    mkdir -p "$lists"
    sed 's|/[^/]*$||' "$new" | sort -u | while read -r folder; do
        mkdir -p "$DESTDIR$folder"
        # Removes what is there first: writing into a program that runs would fail.
        find "$stage$folder" -mindepth 1 -maxdepth 1 ! -type d -exec cp -P --preserve=mode --remove-destination -t "$DESTDIR$folder" {} +
    done
    cat "$new" "$new.folders" > "$lists/$part"
    rm -f "$new.folders"
    while read -r path; do
        case $path in */) continue ;; esac
        grep -qxF -- "$path" "$lists/$part" || listed_elsewhere "$path" "$part" || rm -f "$DESTDIR$path"
    done < "$old"
    rm -rf "$stage" && { rmdir "${stage%/*}" 2>/dev/null || true; }
    echo "installed $(wc -l < "$new") files (${part#install-}) in $DESTDIR$PREFIX"
}

remove() {
    local all path count=0
    [ -d "$lists" ] || { echo "uninstall: nothing of tensormass was installed in $DESTDIR$PREFIX (no $lists); give the PREFIX= and DESTDIR= of the install" >&2; exit 2; }
    all=$(cat "$lists"/* | sort -u)
    while read -r path; do
        case $path in "" | */) continue ;; esac
        [ ! -e "$DESTDIR$path" ] && [ ! -L "$DESTDIR$path" ] || { rm -f "$DESTDIR$path"; count=$((count + 1)); }
    done <<< "$all"
    rm -rf "$lists"
    # The deepest folders first; those with other files stay.
    grep '/$' <<< "$all" | sort -r | while read -r path; do rmdir "$DESTDIR$path" 2>/dev/null || true; done
    echo "removed $count files of tensormass from $DESTDIR$PREFIX"
}

case ${1:-} in
put) put "$2" "$3" ;;
remove) remove ;;
*) echo "usage: tools/install.sh put PART STAGE | remove" >&2; exit 2 ;;
esac
