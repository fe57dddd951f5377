# The library for browsers and node (docs/web.md). Nothing else depends on it: only `make web` and its tests build it.
WEB := $(OUT)/web
WEB_PYTHON = $(abspath $(WEB)/venv)/bin/python
WEB_HEADERS := $(filter-out tensormass_solve=%,$(PYTHON_HEADERS))
# The parser of scenes: the copy of libyaml that a package of PyPI brings as source.
WEB_YAML := ruamel.yaml.clib==0.2.15
WEB_YAML_SRC := $(patsubst %,$(WEB)/yaml/%.c,api reader scanner parser loader)
# One thread: the thread pool is linked but starts no thread.
WEB_SRC := $(filter-out %/module_open.c %/solve_open.c,$(call files,libtensormass/src/*/*.c libtensormass/io/*.c libtensormass/scene/*.c haptic_rt/motion/*.c haptic_rt/core/*.c)) \
	$(patsubst %,libtensormass/platform/%.c,interrupt log_line progress report) $(call files,web/*.c)
WEB_CFLAGS = -std=c11 -D_GNU_SOURCE -O3 -DNDEBUG -ffp-contract=off -fno-math-errno -w $(INCLUDES) -I$(WEB)/yaml -DTM_SOVERSION='"$(SOVERSION)"' \
	-DYAML_VERSION_MAJOR=0 -DYAML_VERSION_MINOR=2 -DYAML_VERSION_PATCH=5 -DYAML_VERSION_STRING='"0.2.5"'
# Also loaded by node, which passes the bytes of the module (runtime.js).
WEB_LDFLAGS = -O3 -sMODULARIZE=1 -sEXPORT_ES6=1 -sUSE_ES6_IMPORT_META=1 -sENVIRONMENT=web,worker -sALLOW_MEMORY_GROWTH=1 -sINITIAL_MEMORY=32MB -sTOTAL_STACK=2MB \
	-sFORCE_FILESYSTEM=1 -sWASM_BIGINT=1 -sALLOW_TABLE_GROWTH=1 -sEXPORTED_FUNCTIONS=@$(WEB)/exports.txt \
	-sEXPORTED_RUNTIME_METHODS=FS,addFunction,removeFunction,UTF8ToString,stringToUTF8,lengthBytesUTF8

$(WEB)/venv/.done: web/requirements.txt
$(WEB)/node_modules/.done: web/package.json
	$(call step,NPM)
	$(Q)command -v npm >/dev/null || tools/setup.sh npm
	$(Q)cp $< $(WEB)/ && cd $(WEB) && npm install --no-audit --no-fund --loglevel=error && touch node_modules/.done
$(WEB)/yaml/yaml.h: $(WEB)/venv/.done
	$(call step,GET)
	$(Q)rm -rf $(@D) && $(WEB_PYTHON) -m pip download -q --disable-pip-version-check --no-deps --no-binary :all: -d $(@D) $(WEB_YAML) && tar xzf $(@D)/*.tar.gz -C $(@D) --strip-components=1 && touch $@
$(WEB_YAML_SRC): | $(WEB)/yaml/yaml.h ;

# $(call web_form,NAME,FLAGS): build/web/obj/NAME/ and build/web/npm/NAME.js: the plain form, and the one with 128-bit vectors.
define web_form
WEB_OBJ_$(1) := $$(patsubst %.c,$(WEB)/obj/$(1)/%.o,$$(WEB_SRC) $$(WEB_YAML_SRC))
$$(WEB_OBJ_$(1)): $(WEB)/obj/$(1)/%.o: %.c web/module.mk $(WEB)/yaml/yaml.h
	$$(call step,EMCC)
	$$(Q)emcc $$(WEB_CFLAGS) $(2) -MMD -MP -c $$< -o $$@
$(WEB)/npm/$(1).js: $$(WEB_OBJ_$(1)) $(WEB)/exports.txt $(WEB)/node_modules/.done web/module.mk
	$$(call step,LINK)
	$$(Q)NODE_PATH=$(abspath $(WEB))/node_modules emcc $(2) $$(WEB_OBJ_$(1)) $$(WEB_LDFLAGS) -o $$@
endef
$(eval $(call web_form,plain,))
$(eval $(call web_form,simd,-msimd128))
-include $(shell find $(WEB)/obj -name '*.d' 2>/dev/null)

$(WEB)/exports.txt: $(WEB)/npm/bindings.js ;
$(WEB)/npm/bindings.js: web/bind.py python/bind.py $(WEB)/venv/.done $(shell find $(filter %/include,$(PYTHON_INCLUDES)) haptic_rt/core/hrt.h -name '*.h')
	$(call step,BIND)
	$(Q)$(WEB_PYTHON) web/bind.py $@ $(WEB)/exports.txt $(PYTHON_INCLUDES) -- $(WEB_HEADERS)
WEB_NPM := $(patsubst web/npm/%,$(WEB)/npm/%,$(call files,web/npm/*))
$(WEB_NPM): $(WEB)/npm/%: web/npm/%
	$(call step,COPY)
	$(Q)sed 's/@VERSION@/$(VERSION)/' $< > $@
# The definitions of the messages, for log.js.
$(WEB)/npm/messages.js: $(call files,lcm_types/*.lcm)
	$(call step,COPY)
	$(Q)node -e 'console.log("export const definitions = " + JSON.stringify(process.argv.slice(1).map((f) => fs.readFileSync(f, "utf8"))) + ";")' $^ > $@
web-npm: $(WEB)/npm/plain.js $(WEB)/npm/simd.js $(WEB)/npm/bindings.js $(WEB)/npm/messages.js $(WEB_NPM)
# The page: one folder of static files. three.js is bundled; the library is copied unchanged, without the plain form: browsers that draw in workers have vectors.
WEB_PAGE := $(patsubst web/page/%,$(WEB)/page/%,$(call files,web/page/*.html web/page/*.css web/page/*.worker.js $(patsubst %,web/page/%.js,own_mesh pauses)))
WEB_DATA := $(patsubst %,$(WEB)/page/data/%,liver_1k.msh liver_10k.msh liver_cut.msh gallbladder_1k.msh block_1k.msh liver-press.yaml liver-cut.yaml cholecystectomy.yaml block-press.yaml)
$(WEB_PAGE): $(WEB)/page/%: web/page/%
	$(call step,COPY)
	$(Q)cp $< $@
$(WEB)/page/data/%.msh: meshes/%.msh
	$(call step,COPY)
	$(Q)cp $< $@
$(WEB)/page/data/%.yaml: apps/scenes/%.yaml
	$(call step,COPY)
	$(Q)cp $< $@
# The organ at rest, for the first picture (boot.js).
WEB_REST := $(patsubst %,$(WEB)/page/data/%.rest.json,liver-press.liver_1k liver-press.liver_10k liver-cut.liver_10k liver-cut.liver_cut cholecystectomy.liver_10k block-press.block_1k)
$(WEB_REST): web/rest.mjs web/page/scenes.js $(WEB)/npm/simd.js $(WEB)/npm/plain.js $(WEB)/npm/bindings.js $(WEB)/npm/messages.js $(WEB_NPM) $(WEB_DATA)
	$(call step,REST)
	$(Q)node web/rest.mjs $(WEB)/npm apps/scenes meshes $@
# main.js and painter.js share what they use of three.js (shared.js); boot.js has nothing of it.
$(WEB)/page/main.js: $(call files,web/page/*.js web/page/*.json) web/npm/vectors.js $(WEB)/node_modules/.done
	$(call step,PACK)
	$(Q)NODE_PATH=$(abspath $(WEB))/node_modules $(WEB)/node_modules/.bin/esbuild web/page/main.js web/page/painter.js --bundle --splitting --chunk-names=shared --minify --format=esm --external:./tissue.worker.js --legal-comments=linked --log-level=warning --outdir=$(@D)
	$(Q)$(WEB)/node_modules/.bin/esbuild web/page/boot.js --bundle --minify --format=esm --log-level=warning --outfile=$(@D)/boot.js
$(WEB)/page/lib/index.js: web-npm
	$(call step,COPY)
	$(Q)cp $(filter-out %.json %.md %.ts $(WEB)/npm/plain.%,$(wildcard $(WEB)/npm/*)) $(@D)/ && rm -f $(@D)/plain.* $(@D)/*.ts
web-page: $(WEB_PAGE) $(WEB_DATA) $(WEB_REST) $(WEB)/page/main.js $(WEB)/page/lib/index.js
# The errors that the page shows beside its choices: an hour of studies. A part: make web-study WEB_STUDIES=block WEB_STUDY_TO=FILE WEB_STUDY_MORE='--finest 3000'
WEB_STUDIES ?= press block cut grasp
WEB_STUDY_TO ?= web/page/study.json
WEB_STUDY_DIR ?= $(WEB)/study
WEB_STUDY_press := --scene apps/scenes/liver-press.yaml --mesh meshes/liver_1k.msh --finest 90000
WEB_STUDY_block := --scene apps/scenes/block-press.yaml --finest 90000
WEB_STUDY_cut := --scene apps/scenes/liver-cut.yaml --finest 40000
WEB_STUDY_grasp := --scene apps/scenes/liver-cut.yaml --duration 4.4s --finest 90000
web-study: $(OUT)/bin/tm-accuracy $(OUT)/bin/tm-sim
	$(Q)mkdir -p $(WEB_STUDY_DIR)
	$(foreach one,$(WEB_STUDIES),nice $(OUT)/bin/tm-accuracy --limit 40min --json $(WEB_STUDY_DIR)/$(one).json $(WEB_STUDY_$(one)) $(WEB_STUDY_MORE) &&) true
	python3 web/study.py $(OUT)/bin/tm-sim web/page/study.json $(WEB_STUDIES:%=$(WEB_STUDY_DIR)/%.json) > $(WEB_STUDY_DIR)/study.json && cp $(WEB_STUDY_DIR)/study.json $(WEB_STUDY_TO)
.PHONY: web-npm web-page web-study
#: make web                    the library for browsers and node: the npm package in build/web/npm/, the page in build/web/page/
web:
	$(call ready,web,web-npm web-page)
	@echo "page: (cd $(WEB)/page && python3 -m http.server), then open http://localhost:8000"
