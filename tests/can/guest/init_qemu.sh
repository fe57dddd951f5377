#!/bin/sh
# First process of the QEMU guest: modules, the host's tree over 9p, then guest.sh's job inside it. Ends by isa-debug-exit.
export PATH=/bin
finish() { printf "\\$(printf %03o "$1")" | /bin/busybox dd of=/dev/port bs=1 seek=244 count=1 conv=notrunc 2>/dev/null; poweroff -f; }
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs dev /dev
for module in $(cat /modules/order); do
    insmod /modules/$module.ko || { echo "guest: insmod $module failed"; finish 125; }
done
for word in $(cat /proc/cmdline); do
    case $word in
    tm_run=*) run=${word#tm_run=} ;;
    esac
done
mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144,cache=loose host /host || { echo "guest: 9p mount failed"; finish 125; }
chroot /host /bin/dash "$run/inside.sh" "$run"
finish $?
