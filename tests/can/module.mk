# SocketCAN in a guest kernel: haptic-rt and tm-device unchanged, watched by stock candump. A skip is not a pass.
#: make check-can            haptic-rt and tm-device over a real kernel's CAN, in a guest
.PHONY: check-can guest-kernel
guest-kernel:
	@tools/setup.sh build check
	@tests/can/guest/kernel.sh $(BUILD)/guest
check-can:
	@tools/setup.sh build check
	@$(MAKE) --no-print-directory programs venv guest-kernel $(OUT)/tests/can/codec.so
	TM_OUT=$(abspath $(OUT)) $(VENV)/bin/python -m pytest tests/can -q -p no:cacheprovider $(PYTEST_ARGS)
