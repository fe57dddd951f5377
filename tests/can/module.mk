# SocketCAN in a guest kernel: haptic-rt and tm-device unchanged, watched by stock candump. A skip is not a pass.
.PHONY: check-can guest-kernel
guest-kernel:
	@tools/setup.sh check
	@tests/can/guest/kernel.sh $(BUILD)/guest
check-can: setup-build
	@tools/setup.sh check
	@$(MAKE) --no-print-directory programs venv guest-kernel
	TM_OUT=$(OUT) $(VENV)/bin/python -m pytest -q tests/can
