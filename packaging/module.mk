#: make deb                    Debian packages in build/deb/
.PHONY: deb
deb:
	@tools/setup.sh build deb
	@packaging/deb.sh $(OUT) $(VERSION) $(SOVERSION)

#: make cross                  core, tensormass_io and the controller's core for Windows, arm64 Linux and macOS: build/cross/
CROSS_VENV := $(OUT)/cross/venv
CROSS ?= x86_64-windows aarch64-linux aarch64-macos x86_64-macos
.PHONY: cross
cross: $(CROSS_VENV)/.done
	@packaging/cross.sh $(OUT) $(VERSION) $(SOVERSION) "$(abspath $(CROSS_VENV))/bin/python -m ziglang" $(CROSS)
$(CROSS_VENV)/.done: packaging/requirements.txt
	@mkdir -p $(@D)
	@/usr/bin/python3 -m venv $(@D)
	@$(@D)/bin/pip install -q --disable-pip-version-check -r $< || { echo "make cross: pip could not install what packaging/requirements.txt names; check the network or the package index" >&2; exit 2; }
	@touch $@
