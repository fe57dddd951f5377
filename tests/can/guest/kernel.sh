#!/bin/bash
# Extracts the Debian kernel (vmlinuz, unpacked if that starts, and the modules a guest needs) from its package without installing it, and packs the small
# first root of the QEMU guest.   tests/can/guest/kernel.sh DIR   leaves DIR/vmlinuz, DIR/initramfs.gz; does nothing if they exist.
set -euo pipefail
dir=$1
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$dir"
exec 9>"$dir/.lock"
flock 9

# In load order; init_qemu.sh reads it from the file `order`.
virtio="virtio_ring virtio virtio_pci_legacy_dev virtio_pci_modern_dev virtio_pci netfs fscache 9pnet 9pnet_virtio 9p"
can="can can-raw can-dev vcan sja1000 kvaser_pci"

if [ ! -s "$dir/vmlinuz" ]; then
    rm -rf "$dir/deb" "$dir/root"
    mkdir -p "$dir/deb" "$dir/modules"
    fetch() {
        package=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: //p' | head -1)
        [ -n "$package" ] && (cd "$dir/deb" && timeout 600 apt-get download -q "$package" >../download.log 2>&1)
    }
    # Package lists may be missing or older than the mirror.
    fetch || { $([ "$(id -u)" = 0 ] || echo sudo -n) timeout 300 apt-get update -q >"$dir/update.log" 2>&1; fetch; } || {
        cat "$dir/download.log" >&2 2>/dev/null || true
        echo "guest: could not download ${package:-linux-image-amd64}; check the network, run apt-get update, then the same command again" >&2
        exit 2
    }
    dpkg -x "$dir"/deb/*.deb "$dir/root"
    for module in $virtio $can; do
        cp "$(find "$dir/root" -name "$module.ko" -print -quit)" "$dir/modules/" || { echo "guest: $package has no module $module" >&2; exit 1; }
    done
    cp "$dir"/root/boot/vmlinuz-* "$dir/vmlinuz.part"
    # An ELF kernel with a PVH note (note 18) starts uncompressed: the emulated processor would take 4 s to unpack it.
    at=$(LC_ALL=C grep -aobP -m1 '\xfd7zXZ\x00' "$dir/vmlinuz.part" | head -n1 | cut -d: -f1) || true
    tail -c +$((${at:-0} + 1)) "$dir/vmlinuz.part" | xz -dcq >"$dir/vmlinux" 2>/dev/null || true
    if readelf -n "$dir/vmlinux" 2>/dev/null | grep 'Xen .*0x00000012' >/dev/null; then mv "$dir/vmlinux" "$dir/vmlinuz.part"; fi
    mv "$dir/vmlinuz.part" "$dir/vmlinuz"
    rm -rf "$dir/root" "$dir/deb" "$dir/vmlinux"
fi

if [ ! -s "$dir/initramfs.gz" ] || [ "$here/init_qemu.sh" -nt "$dir/initramfs.gz" ] || [ "$here/kernel.sh" -nt "$dir/initramfs.gz" ]; then
    root="$dir/initramfs"
    rm -rf "$root"
    mkdir -p "$root"/{bin,dev,proc,sys,host,modules}
    cp "$(command -v busybox)" "$root/bin/busybox"
    for tool in sh mount insmod chroot poweroff sleep cat; do ln -s busybox "$root/bin/$tool"; done
    cp "$dir"/modules/*.ko "$root/modules/"
    echo "$virtio $can" > "$root/modules/order"
    install -m 755 "$here/init_qemu.sh" "$root/init"
    (cd "$root" && find . | /bin/busybox cpio -o -H newc 2>/dev/null | gzip -1) > "$dir/initramfs.part"
    mv "$dir/initramfs.part" "$dir/initramfs.gz"
    rm -rf "$root"
fi
