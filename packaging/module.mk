#: make deb                    Debian packages in build/deb/
deb:
	@tools/setup.sh build deb
	@packaging/deb.sh $(OUT) $(VERSION) $(SOVERSION)
#: make cross                  core, tensormass_io and the controller's core for Windows, arm64 Linux and macOS: build/cross/
CROSS ?= x86_64-windows aarch64-linux aarch64-macos x86_64-macos
$(OUT)/cross/venv/.done: packaging/requirements.txt
cross: $(OUT)/cross/venv/.done
	@packaging/cross.sh $(OUT) $(VERSION) $(SOVERSION) "$(abspath $(OUT))/cross/venv/bin/python -m ziglang" $(CROSS)
