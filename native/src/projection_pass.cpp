#include "projection_pass.hpp"

#include <limits>

namespace nacre {

namespace {

constexpr Index kGatheredFloats = 1 << 20;

std::vector<bool> in_full(const Bases& bases, Index whole) {
    std::vector<bool> modes(bases.size());
    for (std::size_t n = 0; n < bases.size(); ++n) {
        modes[n] = bases[n] || static_cast<Index>(n) == whole;
    }
    return modes;
}

// Multiplications for each element that contracting these modes in this order takes.
double cost(const std::vector<Index>& order, const Bases& bases) {
    double sum = 0, left = 1;
    for (Index n : order) {
        const double rows = static_cast<double>(bases[at(n)]->rows());
        const double columns = static_cast<double>(bases[at(n)]->cols());
        sum += left * columns;
        left *= columns / rows;
    }
    return sum;
}

}  // namespace

ProjectionPass::ProjectionPass(const TensorSource& source, Bases bases, Index whole)
    : source_(source),
      bases_(std::move(bases)),
      grid_(source, in_full(bases_, whole)),
      order_(product_order(bases_, Op::kTranspose)),
      result_shape_(source.shape()) {
    for (Index n : order_) result_shape_[at(n)] = bases_[at(n)]->cols();
    if (grid_.block_floats() > kBlockFloats && !order_.empty()) choose_split();
}

void ProjectionPass::choose_split() {
    // The mode that makes parts small enough and costs least; never the innermost if there is a
    // choice, whose parts would be short runs.
    const Index innermost = static_cast<Index>(bases_.size()) - 1;
    const auto part_floats = [&](Index n) {
        return grid_.block_floats() / bases_[at(n)]->rows() * source_.granularity(n);
    };
    double least = std::numeric_limits<double>::infinity();
    std::vector<Index> best;
    for (Index n : order_) {
        if (n == innermost && order_.size() > 1) continue;
        std::vector<Index> order = order_;
        order.erase(std::find(order.begin(), order.end(), n));
        order.push_back(n);
        double rank = cost(order, bases_);
        if (part_floats(n) > kBlockFloats) rank = 1e9 * static_cast<double>(part_floats(n));
        if (rank < least) {
            least = rank;
            best = order;
        }
    }
    order_ = best;
    split_ = order_.back();
    const Index rows = bases_[at(split_)]->rows(), grain = source_.granularity(split_);
    part_ = std::min(rows, std::max<Index>(1, kBlockFloats / part_floats(split_)) * grain);
    Index row_floats = 1;
    for (std::size_t n = 0; n < bases_.size(); ++n) {
        if (static_cast<Index>(n) == split_) continue;
        row_floats *= bases_[n] ? bases_[n]->cols() : grid_.chunk()[n];
    }
    const Index parts = std::max<Index>(1, kGatheredFloats / (row_floats * part_));
    gathered_ = std::min(rows, parts * part_);
}

// Contracts modes of what is in scratch.a, of shape `size`.
const float* ProjectionPass::contract_all(const std::vector<Index>& modes, Shape& size,
                                          Scratch& scratch) const {
    for (Index n : modes) {
        if (n == split_) continue;
        const Unfolding view = unfolding(size, n);
        size[at(n)] = bases_[at(n)]->cols();
        scratch.b.reserve(product(size));
        mode_product(scratch.a.data(), view, *bases_[at(n)], Op::kTranspose, scratch.b.data());
        std::swap(scratch.a, scratch.b);
    }
    return scratch.a.data();
}

const float* ProjectionPass::run(Index block, Scratch& scratch, Shape& begin, Shape& size) const {
    grid_.block(block, begin, size);
    if (split_ >= 0) return run_split(begin, size, scratch);
    scratch.a.reserve(product(size));
    source_.read(begin, size, scratch.a.data());
    return contract_all(order_, size, scratch);
}

const float* ProjectionPass::run_split(Shape& begin, Shape& size, Scratch& scratch) const {
    const MatrixF& basis = *bases_[at(split_)];
    Shape sum_size = size;
    for (Index n : order_) sum_size[at(n)] = bases_[at(n)]->cols();
    scratch.sum.reserve(product(sum_size));
    for (Index first = 0; first < basis.rows(); first += gathered_) {
        Shape gathered_size = sum_size;
        gathered_size[at(split_)] = std::min(gathered_, basis.rows() - first);
        scratch.gathered.reserve(product(gathered_size));
        const Index end = first + gathered_size[at(split_)];
        for (Index row = first; row < end; row += part_) {
            Shape part_begin = begin, part = size;
            part_begin[at(split_)] = row;
            part[at(split_)] = std::min(part_, end - row);
            scratch.a.reserve(product(part));
            source_.read(part_begin, part, scratch.a.data());
            contract_all(order_, part, scratch);
            Shape place(part.size(), 0);
            place[at(split_)] = row - first;
            copy_in(scratch.a.data(), place, part, gathered_size, scratch.gathered.data());
        }
        contract(scratch.gathered.data(), unfolding(gathered_size, split_),
                 basis.data() + first * basis.cols(), basis.cols(), first > 0, scratch.sum.data());
    }
    size = sum_size;
    return scratch.sum.data();
}

}  // namespace nacre
