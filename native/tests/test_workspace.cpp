#include <csignal>
#include <filesystem>

#include "check.hpp"
#include "nacre/pages.hpp"
#include "nacre/workspace.hpp"

#if defined(__linux__)
#include <sys/resource.h>
#include <unistd.h>
#endif

using namespace nacre;

int main() {
    // No bound: plain memory.
    Workspace free;
    CHECK(!free.bounded());
    CHECK(!free.tensor({3, 4}).mapped());

#if defined(__linux__)
    const std::filesystem::path folder =
        std::filesystem::temp_directory_path() / ("nacre-test-" + std::to_string(getpid()));
    std::filesystem::create_directory(folder);

    // No room at all: every tensor is in a file that nobody sees, and keeps what is written to it.
    Workspace none(1, folder.string());
    CHECK(none.bounded() && none.room() == 0);
    Tensor kept;
    {
        Tensor tensor = none.tensor({300, 1000});
        CHECK(tensor.mapped() && is_empty(folder));
        CHECK(tensor.shape() == Shape({300, 1000}) && tensor.size() == 300'000);
        for (Index i = 0; i < tensor.size(); ++i) tensor.data()[i] = static_cast<float>(i);
        tensor.drop();
        for (Index i = 0; i < tensor.size(); ++i) CHECK(tensor.data()[i] == static_cast<float>(i));
        const float* place = tensor.data();
        tensor.reset({100, 1000});
        CHECK(tensor.mapped() && tensor.data() == place);
        kept = std::move(tensor);
        tensor.reset({2});  // what was moved from starts anew
        CHECK(tensor.data() != place && !tensor.mapped());
    }
    CHECK(kept.mapped() && kept.data()[99'999] == 99'999);
    const Tensor copy = kept;
    CHECK(!copy.mapped() && copy.data()[99'999] == 99'999);
    copy.drop();  // nothing to drop
    CHECK(copy.data()[99'999] == 99'999);
    kept.reset({301, 1000});  // more than it holds
    CHECK(!kept.mapped());

    // Files do not count as memory.
    const std::size_t before = anonymous_memory();
    Tensor large = none.tensor({25, 1'000'000});
    large.fill(1);
    CHECK(anonymous_memory() < before + 20'000'000);
    large.drop();
    CHECK(large.data()[24'999'999] == 1);

    // Room for one of two. It comes back, even to a workspace that is gone.
    Tensor left;
    {
        Workspace some(anonymous_memory() + Workspace::kReserve + 6'000'000, folder.string());
        const std::size_t room = some.room();
        CHECK(room > 4'000'000 && room < 8'000'000);
        {
            const Tensor first = some.tensor({1'000'000});
            CHECK(!first.mapped() && some.room() == room - 4'000'000);
            CHECK(some.tensor({1'000'000}).mapped());
        }
        CHECK(some.room() == room);
        some.set_aside(1000);
        CHECK(some.room() == room - 1000);
        left = some.tensor({1'000'000});
        CHECK(!left.mapped() && some.room() == room - 4'001'000);
        left.reset({2'000'000});  // in memory that is not counted
        CHECK(some.room() == room - 1000);
        left = some.tensor({1'000'000});
        some.set_aside(room);
        CHECK(some.room() == 0);
    }
    left = Tensor();

    // No room on the disk: one line, and nothing is left.
    std::signal(SIGXFSZ, SIG_IGN);
    rlimit limit{};
    getrlimit(RLIMIT_FSIZE, &limit);
    const rlimit small{1'000'000, limit.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
    CHECK(message_of([&] { none.tensor({1'000'000}); }) ==
          "scratch: cannot put 5 MB in " + folder.string() + ": File too large");
    setrlimit(RLIMIT_FSIZE, &limit);
    CHECK(is_empty(folder));
    std::filesystem::remove(folder);
    CHECK(message_of([&] { none.tensor({10}); }) ==
          "scratch: cannot put 1 MB in " + folder.string() + ": No such file or directory");
#else
    CHECK(message_of([] { Workspace(1); }) == "memory: a bound is not supported on this system");
#endif
    std::puts("ok");
}
