" Vim syntax file
" Language: piola, interaction potentials of peridynamics
" License:  MIT OR Apache-2.0

if exists('b:current_syntax')
  finish
endif
let s:save = &cpoptions
set cpoptions&vim

syntax case match
syntax iskeyword @,48-57,_,181,192-255

" Keywords win over matches that begin at the same place, so names of functions, which are free
" where no parenthesis follows, are matches.
syntax match piolaNumber /\%(\k\|\.\)\@1<!\%(\d\+\%(\.\d*\)\=\|\.\d\+\)\%([eE][-+]\=\d\+\)\=/
syntax match piolaOperator /[-+*\/:^=<>!']/
syntax match piolaUser /\<\%(\K\k*\)\ze\s*(/

syntax match piolaFunction /\<\%(sqrt\|exp\|ln\|log1p\|expm1\|log1pmx\|sin\|cos\|tan\|asin\|acos\|atan\|sinh\|cosh\|tanh\|erf\|abs\|sign\|min\|max\|atan2\)\>\ze\s*(/
syntax match piolaFunction /\<\%(sum\|table\|rate\|integral\|neighbour\)\>\ze\s*(/

syntax match piolaEnergy /^\s*\zs\%(psi\|ψ\|dissipation\)\>\ze\s*(/
syntax match piolaDefined /^\s*\zs\K\k*\ze\s*=\%(=\)\@!/
syntax match piolaDefinedFunction /^\s*\zs\K\k*\ze\s*([^()]*)\s*=\%(=\)\@!/ contains=piolaEnergy,piolaStatement

syntax keyword piolaDeclaration potential parameter state nextgroup=piolaDeclared skipwhite
syntax match   piolaDeclared /\K\k*/ contained
syntax keyword piolaStatement source allow dimensions domain update
syntax keyword piolaStatement in nextgroup=piolaUnit skipwhite
syntax keyword piolaStatement weights nextgroup=piolaWeights skipwhite
syntax match   piolaWeights /\<volumes\>/ contained
syntax keyword piolaInclude import
syntax keyword piolaBreak break when
syntax keyword piolaConditional if then else
syntax keyword piolaLogic and or not
syntax keyword piolaConstant pi π inf delta δ d dt
syntax keyword piolaMeasure l L a A v V F xi ξ Xi Ξ

" These are names of the language in some files alone, and free in all others.
if !search('^\s*\%(parameter\s\+\|state\s\+\)\=\%([lL][1-6]\|[aA][1-4]\|[aA]ngle\)\>\s*\%(=\|(\|in\>\|,\|"\|$\)', 'nw')
  syntax keyword piolaMeasure l1 l2 l3 l4 l5 l6 L1 L2 L3 L4 L5 L6 a1 a2 a3 a4 A1 A2 A3 A4 angle Angle
endif
if search('^\s*\%(psi\|ψ\)\s*(\s*F\s*)', 'nw') || search('\<\%(Xi\|xi\|Ξ\|ξ\)\>', 'nw')
  syntax keyword piolaMeasure I
  syntax match piolaFunction /\<\%(tr\|det\|inv\|dev\|sym\|dyad\|vector\|norm\)\>\ze\s*(/
endif
if search('^\s*\%(psi\|ψ\)\s*(\s*F\s*)', 'nw')
  syntax keyword piolaMeasure J C E U I1 I2 I3
  syntax match piolaFunction /\<I[45]\>\ze\s*(/
endif

" A unit goes on to the comma, the text, or the end of its line.
syntax match piolaUnit /[^ \t\[(,"#][^,"#]*/ contained contains=piolaNumber,piolaOperator,piolaUnitName,piolaConstant
syntax match piolaUnitName /\<\%(f\|p\|n\|u\|µ\|μ\|mu\|m\|c\|k\|M\|G\|T\)\=\%(m\|g\|s\|K\|N\|J\|Pa\|W\|Hz\|rad\)\>/ contained

syntax region piolaString start=/"/ end=/"/ oneline
syntax match piolaComment /#.*$/ contains=@Spell,piolaTodo
syntax keyword piolaTodo TODO FIXME XXX contained

highlight default link piolaNumber Number
highlight default link piolaOperator Operator
highlight default link piolaUser Function
highlight default link piolaFunction Special
highlight default link piolaEnergy Keyword
highlight default link piolaDefined Identifier
highlight default link piolaDefinedFunction Function
highlight default link piolaDeclaration StorageClass
highlight default link piolaDeclared Identifier
highlight default link piolaStatement Statement
highlight default link piolaWeights Constant
highlight default link piolaInclude Include
highlight default link piolaBreak Keyword
highlight default link piolaConditional Conditional
highlight default link piolaLogic Operator
highlight default link piolaConstant Constant
highlight default link piolaMeasure Type
highlight default link piolaUnitName Type
highlight default link piolaString String
highlight default link piolaComment Comment
highlight default link piolaTodo Todo

let b:current_syntax = 'piola'
let &cpoptions = s:save
unlet s:save
