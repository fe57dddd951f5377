# The reference as HTML and the programs' man pages. Nothing else depends on it.
SITE := $(OUT)/site
SITE_HEADERS := $(wildcard libtensormass/include libtensormass/include/tensormass libtensormass/*/include) haptic_rt/core/hrt.h
$(SITE)/venv/.done: tools/site/requirements.txt
#: make docs                   guides, C and Python interfaces and programs as HTML with one search: build/site/html; with the page, where Emscripten is
docs: man $(if $(shell command -v emcc),web-page)
	$(call ready,docs,$(SITE)/venv/.done)
	@mkdir -p $(SITE)/doxygen
	@sed -e 's|@INPUT@|$(SITE_HEADERS)|' -e 's|@OUT@|$(SITE)/doxygen|' -e 's|@SITE@|tools/site|' tools/site/Doxyfile.in > $(SITE)/Doxyfile
	@doxygen $(SITE)/Doxyfile
	@$(SITE)/venv/bin/python tools/site/site.py $(SITE)/source $(OUT)/reference/man1 $(wildcard $(WEB)/page/main.js)
	@rm -rf $(SITE)/html
	@TM_VERSION=$(VERSION) TM_DOXYGEN=$(abspath $(SITE)/doxygen/xml) TM_PYTHON=$(abspath python/tensormass) PYTHONWARNINGS=ignore \
		$(SITE)/venv/bin/sphinx-build -b html -q -W --keep-going $(SITE)/source $(SITE)/html
	@if [ -f $(WEB)/page/main.js ]; then cp -r $(WEB)/page $(SITE)/html/try; fi
	@echo "$(SITE)/html/index.html"
#: make man                    man pages and completion of every program: build/reference
man: programs
	@/usr/bin/python3 tools/reference/make_reference.py $(OUT)/bin $(OUT)/reference $(VERSION) $(call REFERENCE_OF,$(PROGRAMS) $(PYTHON_PROGRAMS))
#: make pictures               plots, drawings and tutorial pictures of the pages, drawn anew into docs/images
pictures:
	$(call ready,build demo image,venv programs $(OUT)/lib/tensormass/image.so)
	@for script in architecture plots drawings tutorial; do $(VENV)/bin/python tools/pictures/$$script.py || exit; done
