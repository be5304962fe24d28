/* What CBMC sees around a harness: the C that wasm2c makes of the wasm module (h.c), the five functions that the module imports, and
 * the little of wasm2c's runtime that such a module needs.
 *
 * MEMORY is the size in bytes of the module's linear memory as modelled, HARNESS the export to run. An access beyond MEMORY is a
 * failed assertion, not a hole. With -DREACHABLE the assertions behind the harness must FAIL: a proof whose assumptions contradict
 * each other, or that never comes to a region that it lists, would pass otherwise. */
#include <stdint.h>

#define WASM_RT_MEMCHECK_SIGNAL_HANDLER 0 /* check every access */
#define WASM_RT_USE_STACK_DEPTH_COUNT 0
#define WASM_RT_SKIP_SIGNAL_RECOVERY 1
#define __builtin_memcpy memcpy
#include "h.c"

struct Z_v_instance_t { int none; };

uint32_t nondet_uint32(void);

/* The regions that this run has been in, a bit each. */
static uint64_t covered;

void Z_vZ_cover(struct Z_v_instance_t *v, u32 region, u32 reached) {
#ifdef REACHABLE
  covered |= (uint64_t)(reached != 0) << region;
#endif
}

u32 Z_vZ_nd(struct Z_v_instance_t *v) { return nondet_uint32(); }

void Z_vZ_assume(struct Z_v_instance_t *v, u32 holds) { __CPROVER_assume(holds != 0); }

void Z_vZ_fail(struct Z_v_instance_t *v, u32 line) {
  __CPROVER_assert(0, "the property holds");
  __CPROVER_assume(0);
}

/* The upper half of a signed product; the lower half is the module's own. */
u64 Z_vZ_multiply_high(struct Z_v_instance_t *v, u64 a, u64 b) {
  return (u64)(((__int128)(s64)a * (__int128)(s64)b) >> 64);
}

void wasm_rt_trap(wasm_rt_trap_t code) {
  __CPROVER_assert(0, "no trap: no access out of bounds, no unreachable code reached, no division by zero");
  __CPROVER_assume(0);
}

static uint8_t linear_memory[MEMORY];

bool wasm_rt_is_initialized(void) { return true; }

uint32_t wasm_rt_register_func_type(uint32_t parameters, uint32_t results, ...) { return parameters * 8 + results; }

void wasm_rt_allocate_memory(wasm_rt_memory_t *memory, uint32_t pages, uint32_t most) {
  memory->data = linear_memory;
  memory->pages = pages;
  memory->max_pages = most;
  memory->size = MEMORY;
}

void wasm_rt_free_memory(wasm_rt_memory_t *memory) {}

#define JOINED_(a, b) a##b
#define JOINED(a, b) JOINED_(a, b)

int main(void) {
  static Z_h_instance_t instance;
  static struct Z_v_instance_t imports;
  Z_h_init_module();
  Z_h_instantiate(&instance, &imports);
  __CPROVER_assert(instance.w2c___heap_base <= MEMORY, "the modelled memory covers stack and statics");
  JOINED(Z_hZ_, HARNESS)(&instance);
#ifdef REACHABLE
  __CPROVER_assert(0, "the end of the harness is reachable");
  /* an assertion for each region that the harness lists */
#include "covers.h"
#endif
}
