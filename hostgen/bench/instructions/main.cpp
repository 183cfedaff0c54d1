// One Newton iteration, once, for valgrind to count its instructions: `bench --instructions` runs it. Built for AVX2,
// because valgrind knows no AVX-512.
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <vector>

#include "firmware/model/model.h"
#include "firmware/shape/elements.h"

namespace {

using namespace finsight;

/// The parts of NewtonSolver<float>::take_step, each as a separate function, so that their counts can be told apart.
struct Work {
  explicit Work(const Model& model)
      : cholesky(model.shape.cholesky),
        elements(model.shape, &cholesky),
        x(model.shape.rest_mm.begin(), model.shape.rest_mm.end()),
        step(x.size()),
        gradient(x.size()),
        solution(3 * static_cast<std::size_t>(model.shape.cholesky.blocks)) {}
  Cholesky<float> cholesky;
  Elements<float> elements;
  std::vector<float> x, step, gradient, solution;
};

}  // namespace

extern "C" {
[[gnu::noinline]] void stage_derivatives(Work& w) {
  w.elements.gradient_and_hessian(w.x, w.step, w.gradient, w.cholesky.values());
}
[[gnu::noinline]] bool stage_factor(Work& w) { return w.cholesky.factor(); }
[[gnu::noinline]] void stage_solve(Work& w) { w.cholesky.solve(w.solution); }
[[gnu::noinline]] float stage_step(Work& w) { return w.elements.longest_step(w.x, w.step); }
}

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: bench_instructions PACK\n");
    return 2;
  }
  try {
    const Model model = Model::open(argv[1]);
    Work work(model);
    stage_derivatives(work);
    for (std::size_t i = 0; i < work.solution.size(); ++i) work.solution[i] = work.gradient[i];
    if (!stage_factor(work)) throw std::runtime_error("bench_instructions: the factorisation fails");
    stage_solve(work);
    return stage_step(work) > 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
