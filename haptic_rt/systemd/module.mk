# Files of a dedicated machine: the service, and examples of its settings.
.PHONY: install-systemd
install: install-systemd
install-systemd:
	install -d $(INSTALL_ROOT)/lib/systemd/system $(SHARE)/systemd $(INSTALL_ROOT)/share/doc/tensormass
	sed -e 's|@PREFIX@|$(PREFIX)|' haptic_rt/systemd/haptic-rt@.service.in > $(INSTALL_ROOT)/lib/systemd/system/haptic-rt@.service
	install -m 644 haptic_rt/systemd/haptic-rt-0.conf haptic_rt/systemd/80-can.network $(SHARE)/systemd
	install -m 644 docs/dedicated-machine.md $(INSTALL_ROOT)/share/doc/tensormass
