#!/bin/dash
# First process of the user-mode Linux guest, whose root is the host's own tree. dash, since busybox would run /proc/self/exe,
# which is linux.uml on the host's /proc. Leaves its status in RUN/status.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
for word in "$@"; do
    case $word in tm_run=*) run=${word#tm_run=} ;; esac
done
mount -t proc proc /proc
mount -t sysfs sysfs /sys
status=125
modules=$(echo /usr/lib/uml/modules/*/kernel)
if busybox insmod $modules/net/can/can.ko && busybox insmod $modules/net/can/can-raw.ko && busybox insmod $modules/drivers/net/can/dev/can-dev.ko &&
    busybox insmod $modules/drivers/net/can/vcan.ko; then
    dash "$run/inside.sh" vcan "$run" uml
    status=$?
else
    echo "guest: this user-mode Linux has no CAN modules"
fi
echo $status > "$run/status"
sync
busybox poweroff -f
